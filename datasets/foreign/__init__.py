"""Motions as other programs store them."""
