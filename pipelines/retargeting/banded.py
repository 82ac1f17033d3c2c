"""Linear systems of a chain of frames, each coupled to the three that follow it.

The matrix has one block per frame and a diagonal block to each of the next three. Three frames each
make it block tridiagonal; its blocks are eliminated one after the other.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

REACH = 3
"""Frames that one is coupled to, each way."""


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
        for k in range(1, min(REACH, len(x) - 1) + 1):
            band = self.bands[k - 1, :-k]
            product[:-k] += band * x[k:]
            product[k:] += band * x[:-k]
        return product

    def solve_within(self, right: np.ndarray, basis: np.ndarray, active: np.ndarray) -> np.ndarray:
        """Solve for a vector (N, n) in the span of a basis.

        Args:
            right: (N, n) right-hand side.
            basis: (N, n, n) columns that span what each frame may do, zero where not active.
            active: (N, n) bool, which columns count.

        Raises:
            np.linalg.LinAlgError: The matrix is not positive definite on that span.
        """
        own, following = self._tridiagonal(basis)
        projected = _grouped(basis.transpose(0, 2, 1) @ right[..., None])
        mask = _grouped(active)
        found = np.zeros_like(projected)
        for group, values in enumerate(_eliminated(own, following, projected, mask)):
            found[group, mask[group]] = values
        coordinates = found.reshape(-1, right.shape[1])[: len(right)]
        return (basis @ coordinates[..., None])[..., 0]

    def _tridiagonal(self, basis: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Blocks (G, 3 n, 3 n) of each three frames with themselves and with the next, in a basis.

        Only the upper half of a group with itself is filled in, its frames' own blocks wholly.
        """
        frames, n = basis.shape[:2]
        groups, left = -(-frames // REACH), basis.transpose(0, 2, 1)
        own = np.zeros((groups, REACH, n, REACH, n))
        following = np.zeros_like(own)
        for k in range(min(REACH, frames - 1) + 1):
            if k:
                parts = left[: frames - k] @ (self.bands[k - 1, : frames - k, :, None] * basis[k:])
            else:
                parts = left @ (self.blocks @ basis)
            for first in range(REACH):
                part, second = parts[first::REACH], first + k
                target = own if second < REACH else following
                target[: len(part), first, :, second % REACH] = part
                if 0 < k and second < REACH:
                    own[: len(part), second, :, first] = part.transpose(0, 2, 1)
        shape = (groups, REACH * n, REACH * n)
        return own.reshape(shape), following.reshape(shape)


def _grouped(array: np.ndarray) -> np.ndarray:
    """Three frames each in a row, (N, n, ...) to (G, 3 n); zeros fill the last."""
    flat = array.reshape(array.shape[:2])
    return np.pad(flat, ((0, -len(flat) % REACH), (0, 0))).reshape(-1, REACH * flat.shape[1])


def _eliminated(
    own: np.ndarray, following: np.ndarray, right: np.ndarray, mask: np.ndarray
) -> list[np.ndarray]:
    """Unknowns of each group: forward elimination, then back substitution."""
    places = [np.flatnonzero(row) for row in mask]
    places.append(places[-1][:0])  # nothing follows the last
    steps, carried, moved = [], 0.0, 0.0
    for group, here in enumerate(places[:-1]):
        rows = here[:, None]
        coupling = following[group][rows, places[group + 1]]
        block = own[group][rows, here] - carried
        known = right[group][here] - moved
        np.linalg.cholesky(block)  # raises unless it is positive definite
        step = np.linalg.solve(block, np.concatenate([coupling, known[:, None]], axis=1))
        update = coupling.T @ step
        carried, moved = update[:, :-1], update[:, -1]
        steps.append(step)
    found, after = [], np.zeros(0)
    for step in reversed(steps):
        after = step[:, -1] - step[:, :-1] @ after
        found.append(after)
    return found[::-1]
