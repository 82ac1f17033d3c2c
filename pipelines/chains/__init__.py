"""Experiments, sweeps and jobs: the only place where stages meet."""
