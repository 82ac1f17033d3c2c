"""How fast things are, beside the bare engine in the same call."""
