"""Learning: tensors in, tensors out. No simulator, no disk."""
