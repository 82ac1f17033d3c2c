"""The gait of a walker on two legs: a clock, the stride that a command asks for, mirroring."""
