"""How good a retargeted clip is: the metrics and their picture."""
