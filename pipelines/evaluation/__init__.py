"""Episodes played and counted: errors, falls, skills, robustness."""
