"""A stretch of frames, and all that is asked of them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lacoloco.datasets import rotations
from lacoloco.pipelines.retargeting.solve.pose_problem import TURN

THIRD = (-1.0, 3.0, -3.0, 1.0)
"""Third difference of four frames."""


@dataclass(frozen=True)
class Stretch:
    """N frames of a clip and all that is asked of them; V constraint values per frame."""

    guess: np.ndarray
    """(N, n) variables to start from."""
    parameters: np.ndarray
    """(N, m) parameters of the frames, the reference orientation first."""
    variable_bounds: tuple[np.ndarray, np.ndarray]
    """(N, n) each."""
    value_bounds: tuple[np.ndarray, np.ndarray]
    """(N, V) each."""
    step_limit: np.ndarray
    """(J,) most that a joint may move from frame to frame, rad."""

    def sampled(self, stride: int) -> Stretch:
        """Every so many frames of it."""
        (lower, upper), (lower_values, upper_values) = self.variable_bounds, self.value_bounds
        return Stretch(
            guess=self.guess[::stride],
            parameters=self.parameters[::stride],
            variable_bounds=(lower[::stride], upper[::stride]),
            value_bounds=(lower_values[::stride], upper_values[::stride]),
            step_limit=self.step_limit * stride,
        )


def turn_pull(reference: np.ndarray, smoothness: np.ndarray) -> np.ndarray:
    """Linear cost (N, n) that makes the roughness of the turns that of the whole orientation.

    The orientation is a turn on top of a reference; third differences of the orientation are those
    of the turns plus second differences of the reference's own steps (to first order in the turns).

    Args:
        reference: (N, 4) quaternions, wxyz.
        smoothness: (n,) weights of the squared third differences.
    """
    pull = np.zeros((len(reference), len(smoothness)))
    if len(reference) >= len(THIRD):
        steps = rotations.angular_velocity_b(reference[:-1], reference[1:], 1.0)
        rough = 2 * smoothness[TURN] * np.diff(steps, 2, axis=0)
        for shift, value in enumerate(THIRD):
            pull[shift : shift + len(rough), TURN] += value * rough
    return pull
