"""What all trainings share: loop, checkpoints, log, diagnostics."""
