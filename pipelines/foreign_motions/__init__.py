"""Motions of other programs, in and out."""
