"""Doing something to some of the worlds, without asking a GPU how many they are.

Which worlds is said in one of two ways: on the CPU by their numbers, (K,) int64, with K rows of
values; on a GPU, where counting them would make the host wait, by a mask, (N,) bool, with a row of
values for every world. ``len`` of either is how many rows of values it takes.
"""

from __future__ import annotations

import torch


def select(mask: torch.Tensor) -> torch.Tensor:
    """The worlds where ``mask`` (N,) is true: their numbers (K,) on the CPU, the mask itself
    elsewhere.
    """
    return mask if mask.is_cuda else torch.nonzero(mask).flatten()


def pick(values: torch.Tensor, worlds: torch.Tensor) -> torch.Tensor:
    """The rows of ``values`` (N, ...) that ``worlds`` take: (K, ...) for numbers, all of them for a
    mask.
    """
    return values if worlds.dtype == torch.bool else values[worlds]


def put(target: torch.Tensor, worlds: torch.Tensor, values: torch.Tensor | float) -> None:
    """Overwrite the rows of ``target`` (N, ...) in place: ``values`` has as many rows as
    ``worlds``, or is a number or row.
    """
    if worlds.dtype == torch.bool:
        target.copy_(torch.where(worlds.view(-1, *[1] * (target.dim() - 1)), values, target))
    else:
        target[worlds] = values


def perhaps_any(mask: torch.Tensor) -> bool:
    """Whether any of ``mask`` is true; on a GPU always, since looking would make the host wait."""
    return mask.is_cuda or bool(mask.any())
