"""Simulation: the only place that imports a physics engine; everything above it is torch."""
