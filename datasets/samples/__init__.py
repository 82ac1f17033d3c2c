"""Data that comes with lacoloco, and the scripts that made it."""

from __future__ import annotations

from pathlib import Path

DOG_BVH = Path(__file__).parent / "dog_walk_trot_turn.bvh"
"""A synthetic dog that walks, trots and turns: 12 s at 60 Hz, made by `make_dog`."""

HUMAN_BVH = Path(__file__).parent / "human_walk_turn.bvh"
"""A synthetic person who walks and turns: 10 s at 60 Hz, made by `make_human`."""

SAMPLES = (DOG_BVH, HUMAN_BVH)
"""All of them."""
