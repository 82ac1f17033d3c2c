"""Inequalities as a primal-dual interior-point method sees them: slacks, multipliers, a barrier."""

from __future__ import annotations

import numpy as np

LEAST_SLACK = 0.01
"""m or rad; slack to begin with where a bound is near or broken."""
LEAST_MULTIPLIER = 0.1
"""To begin with. That of the barrier alone is so weak far from a bound that first steps run into
it.
"""
TO_BOUNDARY = 0.99
"""Share of the way to where a slack or a multiplier would vanish that a step may go."""


class Barrier:
    """Bounds of R rows, those that are infinite left out.

    Attributes:
        slacks: Distances to the bounds, held positive; they become true as rows reach feasibility.
        multipliers: Of the bounds, positive.
    """

    def __init__(self, lower: np.ndarray, upper: np.ndarray, mu: float, rows: np.ndarray) -> None:
        """Begin.

        Args:
            lower: (R,) bounds, or -inf.
            upper: (R,) bounds, or inf.
            mu: Product of slack and multiplier that is aimed at.
            rows: (R,) values at the guess.
        """
        self._mu, self._count = mu, len(rows)
        self._low, self._high = (np.flatnonzero(np.isfinite(bound)) for bound in (lower, upper))
        self._bounds = self._signed(lower, upper)
        room = 0.25 * (upper - lower)
        room = np.minimum(np.concatenate([room[self._low], room[self._high]]), LEAST_SLACK)
        self.slacks = np.maximum(self.distances(rows), room)
        self.multipliers = np.maximum(mu / self.slacks, LEAST_MULTIPLIER)

    def distances(self, rows: np.ndarray) -> np.ndarray:
        """How far rows are from their bounds, negative where they break them."""
        return self._signed(rows, rows) - self._bounds

    def condensed(self, rows: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Curvature (R,) and force (R,) that stand for slacks and multipliers in a step."""
        stiffness = self.multipliers / self.slacks
        missed = self.distances(rows) - self.slacks
        low, high = self._spread(stiffness)
        inward, outward = self._spread(self._mu / self.slacks - stiffness * missed)
        return low + high, inward - outward

    def step(self, rows: np.ndarray, change: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Steps of slacks and multipliers that go with a change (R,) of the rows."""
        slacks = self._signed(change, change) + self.distances(rows) - self.slacks
        multipliers = (self._mu - self.multipliers * slacks) / self.slacks - self.multipliers
        return slacks, multipliers

    def outward(self) -> np.ndarray:
        """Multipliers (R,) of the rows in the Lagrangian: those above less those below."""
        low, high = self._spread(self.multipliers)
        return high - low

    def value(self, slacks: np.ndarray) -> float:
        """What the barrier adds to the cost."""
        return -self._mu * float(np.log(slacks).sum())

    def _signed(self, low: np.ndarray, high: np.ndarray) -> np.ndarray:
        return np.concatenate([low[self._low], -high[self._high]])

    def _spread(self, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        low, high = np.zeros((2, self._count))
        low[self._low], high[self._high] = np.split(values, [len(self._low)])
        return low, high


def longest_step(values: np.ndarray, change: np.ndarray) -> float:
    """Share of a change, at most 1, after which positive values are still positive."""
    shrinking = change < 0
    ways = values[shrinking] / -change[shrinking]
    return min(1.0, TO_BOUNDARY * float(ways.min(initial=np.inf)))
