"""What each frame may do while its planted feet stay where they are."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Planted:
    """Frames with equally many equations, and the QR factors of their gradients."""

    frames: np.ndarray
    """(M,) their numbers."""
    rows: np.ndarray
    """(M, C) which constraint values they are."""
    range_basis: np.ndarray
    """(M, n, C) orthonormal."""
    triangle: np.ndarray
    """(M, C, C) gradients in that basis."""


@dataclass(frozen=True)
class NullSpace:
    """Steps of N frames of n variables that meet the linearised equations.

    Such a step is `particular` plus any combination of the columns of `basis` that count.
    """

    basis: np.ndarray
    """(N, n, n) orthonormal columns; as many of the first as there are equations do not count."""
    particular: np.ndarray
    """(N, n) shortest step that meets them."""
    planted: tuple[Planted, ...]

    def multipliers(self, force: np.ndarray, values: int) -> np.ndarray:
        """Multipliers (N, V) with which the equations balance a force (N, n)."""
        multipliers = np.zeros((len(force), values))
        for group in self.planted:
            along = group.range_basis.transpose(0, 2, 1) @ force[group.frames][..., None]
            found = np.linalg.solve(group.triangle, along)[..., 0]
            multipliers[group.frames[:, None], group.rows] = found
        return multipliers


def null_space(
    gradients: np.ndarray, equal: np.ndarray, gap: np.ndarray, held: np.ndarray
) -> NullSpace:
    """Null space of the equations of every frame.

    Args:
        gradients: (N, n, V) of the constraint values.
        equal: (N, V) bool, which of them are equations.
        gap: (N, V) by how much they are missed.
        held: (N,) bool, frames that may not move.
    """
    frames, n, _ = gradients.shape
    basis, particular, planted = np.zeros((frames, n, n)), np.zeros((frames, n)), []
    for where, rows in _alike(equal, held):
        count = rows.shape[1]
        here = np.take_along_axis(gradients[where], rows[:, None], axis=2)
        orthogonal, triangle = np.linalg.qr(here, mode="complete")
        triangle, within = triangle[:, :count], orthogonal[:, :, :count]
        missed = np.take_along_axis(gap[where], rows, axis=1)[..., None]
        step = within @ np.linalg.solve(triangle.transpose(0, 2, 1), -missed)
        particular[where], basis[where] = step[..., 0], orthogonal
        planted.append(Planted(where, rows, within, triangle))
    return NullSpace(basis, particular, tuple(planted))


def _alike(equal: np.ndarray, held: np.ndarray) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """Frames that move and have equally many equations, and which these are (M, C)."""
    counts = np.where(held, -1, equal.sum(1))
    for count in np.unique(counts[~held]):
        where = np.flatnonzero(counts == count)
        yield where, np.nonzero(equal[where])[1].reshape(len(where), count)
