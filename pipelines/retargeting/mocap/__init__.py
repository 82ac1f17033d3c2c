"""What was recorded: files, axes, skeletons, parts."""
