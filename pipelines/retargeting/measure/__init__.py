"""How good a retargeted clip is: the figures and their picture."""
