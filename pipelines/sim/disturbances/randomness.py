"""Draws that leave an environment's own generator alone."""

from __future__ import annotations

import torch

SALT = 0x5EED
"""Added to the seed of the environment."""


def own_generator(seed: int, part: int) -> torch.Generator:
    """A generator on the CPU for one part of the disturbances."""
    return torch.Generator().manual_seed(1_000 * (seed + SALT) + part)


def spread(half: float, shape: tuple[int, ...], generator: torch.Generator) -> torch.Tensor:
    """Uniform from -half to half."""
    return half * (2.0 * torch.rand(shape, generator=generator) - 1.0)


def grades(graded: bool, worlds: int, generator: torch.Generator) -> torch.Tensor:
    """(N,) share that every world has of a disturbance: all of it, or a part of its own."""
    return torch.rand(worlds, generator=generator) if graded else torch.ones(worlds)


def rounded(values: torch.Tensor, generator: torch.Generator) -> torch.Tensor:
    """Whole numbers with these mean values: up with the probability of the fraction."""
    return (values + torch.rand(values.shape, generator=generator)).floor().long()
