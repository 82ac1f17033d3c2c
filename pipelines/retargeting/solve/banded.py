"""Linear systems of a chain of frames, each coupled to the three that follow it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg.lapack import dpbsv

REACH = 3
"""Frames that one is coupled to, each way."""


class BandLayout:
    """Where the blocks of frames go in the band of a matrix over N frames, each with its own size.

    Of the columns of a basis of each frame, some are active; they are the unknowns.
    """

    def __init__(self, active: np.ndarray) -> None:
        """Lay it out.

        Args:
            active: (N, n) bool, which columns are unknowns.
        """
        self._active, frames = active, len(active)
        number = (np.cumsum(active) - 1).reshape(active.shape)
        self._size = int(active.sum())
        before = np.concatenate([[0], np.cumsum(active.sum(axis=1))])
        after = before[np.minimum(np.arange(frames) + REACH + 1, frames)]
        self._width = max(int((after - before[:-1]).max()), 1)
        self._places = [self._block_places(number, k) for k in range(min(REACH, frames - 1) + 1)]

    def _block_places(self, number: np.ndarray, k: int) -> tuple[np.ndarray, np.ndarray]:
        """Flat indices within the blocks (N - k, n, n) of frames k apart, and within the band."""
        frames = len(number) - k
        column, row = number[:frames, :, None], number[k:, None, :]
        used = self._active[:frames, :, None] & self._active[k:, None, :] & (row >= column)
        # LAPACK keeps, column after column, the diagonal and what is below it.
        places = column * self._width + row - column
        return np.flatnonzero(used), places[used]

    def solve(self, blocks: list[np.ndarray], right: np.ndarray) -> np.ndarray:
        """Solve by Cholesky's method.

        Args:
            blocks: (N - k, n, n) of the frames t and t + k, for k from 0 on.
            right: (N, n) right-hand side.

        Returns:
            (N, n), zero where not active.

        Raises:
            np.linalg.LinAlgError: The matrix is not positive definite.
        """
        band = np.zeros(self._size * self._width)
        for block, (source, target) in zip(blocks, self._places, strict=True):
            band[target] = block.ravel()[source]
        columns = band.reshape(self._size, self._width).T
        _, found, failed = dpbsv(columns, right[self._active], lower=1, overwrite_ab=1)
        if failed or not np.isfinite(found).all():
            raise np.linalg.LinAlgError("not positive definite")
        values = np.zeros(right.shape)
        values[self._active] = found
        return values


@dataclass(frozen=True)
class BandedMatrix:
    """A symmetric matrix over N frames of n variables."""

    blocks: np.ndarray
    """(N, n, n) of each frame with itself."""
    bands: np.ndarray
    """(REACH, N, n); [k, t] is the diagonal of the block of the frames t and t + k + 1."""

    def __matmul__(self, x: np.ndarray) -> np.ndarray:
        """Product (N, n) with a vector (N, n)."""
        product = (self.blocks @ x[..., None])[..., 0]
        for k, band in self._bands():
            product[:-k] += band * x[k:]
            product[k:] += band * x[:-k]
        return product

    def solve_within(self, right: np.ndarray, basis: np.ndarray, layout: BandLayout) -> np.ndarray:
        """Solve for a vector (N, n) in the span of a basis.

        Args:
            right: (N, n) right-hand side.
            basis: (N, n, n) columns that span what each frame may do.
            layout: Which of them are active.

        Raises:
            np.linalg.LinAlgError: The matrix is not positive definite on that span.
        """
        left = basis.transpose(0, 2, 1)
        blocks = [left @ (self.blocks @ basis)]
        blocks += [left[:-k] @ (band[..., None] * basis[k:]) for k, band in self._bands()]
        found = layout.solve(blocks, (left @ right[..., None])[..., 0])
        return (basis @ found[..., None])[..., 0]

    def _bands(self) -> list[tuple[int, np.ndarray]]:
        """Distances, and the diagonals (N - k, n) at them."""
        reach = min(REACH, len(self.blocks) - 1)
        return [(k, self.bands[k - 1, :-k]) for k in range(1, reach + 1)]
