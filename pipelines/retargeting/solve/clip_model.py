"""Cost and constraints of a stretch at one point, and the quadratic program around it.

    min_x  sum_t c_t(x_t) + sum_t |third difference of x|_w^2
    s.t.   feet that stand: where they are planted;  feet that swing, knees, hips: above their floor
           joints: within limits, also of speed

Rows of inequalities are all joints, then all constraint values, then all steps of joints from frame
to frame.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lacoloco.pipelines.retargeting.solve.banded import BandedMatrix, BandLayout
from lacoloco.pipelines.retargeting.solve.frame_functions import FrameFunctions
from lacoloco.pipelines.retargeting.solve.null_space import null_space
from lacoloco.pipelines.retargeting.solve.pose_problem import JOINTS
from lacoloco.pipelines.retargeting.targets.stretch import (
    THIRD,
    Stretch,
    roughness_bands,
    turn_pull,
)


@dataclass(frozen=True)
class Point:
    """N frames of n variables, and what they mean for P coordinates and V constraint values."""

    x: np.ndarray
    """(N, n)."""
    cost: float
    missed: np.ndarray
    """(N, P) from targets to coordinates; 0 for those without a target, m."""
    jacobian: np.ndarray
    """(N, n, P), transposed."""
    rough: np.ndarray
    """(N, n) gradient of the smoothness."""
    rows: np.ndarray
    """(R,) values of the inequalities."""
    gap: np.ndarray
    """(N, V) by how much equations are missed; 0 for inequalities."""


class ClipModel:
    """The program of a stretch.

    Attributes:
        lower: (R,) bounds of the inequalities; infinite where there is none.
        upper: (R,).
    """

    def __init__(self, functions: FrameFunctions, stretch: Stretch, smoothness: np.ndarray) -> None:
        """Sort the constraints into equations and inequalities.

        Args:
            functions: Of one frame.
            stretch: The frames; those whose variables have equal bounds do not move.
            smoothness: (n,) weights of the squared third differences.
        """
        self._functions, self._stretch, self._smoothness = functions, stretch, smoothness
        self._pull = turn_pull(stretch.parameters[:, :4], smoothness)
        self._bands = roughness_bands(len(stretch.guess))[..., None] * smoothness
        lower, upper = stretch.variable_bounds
        self._held = (lower == upper).all(axis=1)
        values = stretch.value_bounds
        self._equal = values[0] == values[1]
        free = np.arange(len(smoothness)) >= self._equal.sum(axis=1, keepdims=True)
        self._layout = BandLayout(free & ~self._held[:, None])
        self._planted = np.where(self._equal, values[0], 0.0)
        self.lower, self.upper = (
            self._bounds(-1, lower, values[0]),
            self._bounds(1, upper, values[1]),
        )

    def _bounds(self, sign: int, variables: np.ndarray, values: np.ndarray) -> np.ndarray:
        """Bounds (R,) on one side; none for equations and frames that do not move."""
        none, held = sign * np.inf, self._held
        joints = np.where(held[:, None], none, variables[:, JOINTS])
        values = np.where(self._equal, none, values)
        still = (held[:-1] & held[1:])[:, None]
        return _flat(joints, values, np.where(still, none, sign * self._stretch.step_limit))

    def at(self, x: np.ndarray) -> Point:
        """Evaluate variables (N, n)."""
        functions, parameters = self._functions, self._stretch.parameters
        points, jacobian = functions.geometry(x, parameters)
        targets = parameters[:, 4:]
        missed = np.zeros_like(points)
        missed[:, : targets.shape[1]] = points[:, : targets.shape[1]] - targets
        rough, joints = self._roughness(x), x[:, JOINTS]
        cost = (missed**2).sum() + ((0.5 * rough + self._pull) * x).sum()
        cost += functions.posture_weight * ((joints - functions.neutral) ** 2).sum()
        values = points[:, functions.value_rows]
        return Point(
            x=x,
            cost=float(cost),
            missed=missed,
            jacobian=jacobian.reshape(*x.shape, -1),
            rough=rough,
            rows=_flat(joints, values, np.diff(joints, axis=0)),
            gap=np.where(self._equal, values - self._planted, 0.0),
        )

    def _roughness(self, x: np.ndarray) -> np.ndarray:
        rough = np.zeros_like(x)
        if len(x) >= len(THIRD):
            thirds = 2 * self._smoothness * np.diff(x, 3, axis=0)
            for shift, value in enumerate(THIRD):
                rough[shift : shift + len(thirds)] += value * thirds
        return rough

    def start(self) -> Point:
        """The guess, within the bounds of the variables."""
        return self.at(np.clip(self._stretch.guess, *self._stretch.variable_bounds))

    def change(self, point: Point, step: np.ndarray) -> np.ndarray:
        """Change (R,) of the rows with a step (N, n), to first order."""
        values = (step[:, None] @ point.jacobian)[:, 0, self._functions.value_rows]
        return _flat(step[:, JOINTS], values, np.diff(step[:, JOINTS], axis=0))

    def step(
        self,
        point: Point,
        stiffness: np.ndarray,
        force: np.ndarray,
        outward: np.ndarray,
        multipliers: np.ndarray,
    ) -> tuple[np.ndarray, np.ndarray]:
        """Newton's step.

        Where the curvature of the kinematics leaves the program without a minimum, less of it is
        used, in the end none: Gauss and Newton's.

        Args:
            point: Where.
            stiffness: (R,) of the rows, from the barrier.
            force: (R,) on them, from the barrier.
            outward: (R,) their multipliers.
            multipliers: (N, V) of the equations.

        Returns:
            Step (N, n) and new multipliers (N, V).

        Raises:
            np.linalg.LinAlgError: There is none.
        """
        matrix, right = self._quadratic(point, stiffness, force)
        curvature = self._curvature(point, outward, multipliers)
        gradients = point.jacobian[:, :, self._functions.value_rows]
        space = null_space(gradients, self._equal, point.gap, self._held)
        for share in (1.0, 0.5, 0.25, 0.0):
            bent = BandedMatrix(matrix.blocks + share * curvature, matrix.bands)
            try:
                rest = right - bent @ space.particular
                step = space.particular + bent.solve_within(rest, space.basis, self._layout)
                break
            except np.linalg.LinAlgError:
                if not share:
                    raise
        return step, space.multipliers(right - bent @ step, self._equal.shape[1])

    def _quadratic(
        self, point: Point, stiffness: np.ndarray, force: np.ndarray
    ) -> tuple[BandedMatrix, np.ndarray]:
        """Gauss and Newton's Hessian, and the force (N, n) downhill."""
        functions, jacobian = self._functions, point.jacobian
        stiff_joints, stiff_values, stiff_steps = self._parts(stiffness)
        push_joints, push_values, push_steps = self._parts(force)
        weights, pushes = np.zeros_like(point.missed), -2 * point.missed
        weights[:, : self._stretch.parameters.shape[1] - 4] = 2.0
        weights[:, functions.value_rows] += stiff_values
        pushes[:, functions.value_rows] += push_values
        blocks = (jacobian * weights[:, None]) @ jacobian.transpose(0, 2, 1)
        right = (jacobian @ pushes[..., None])[..., 0] - point.rough - self._pull
        posture = 2 * functions.posture_weight
        right[:, JOINTS] += push_joints - posture * (point.x[:, JOINTS] - functions.neutral)
        right[1:, JOINTS] += push_steps
        right[:-1, JOINTS] -= push_steps
        bands = self._bands.copy()
        bands[0, :, JOINTS] += posture + stiff_joints
        bands[0, 1:, JOINTS] += stiff_steps
        bands[0, :-1, JOINTS] += stiff_steps
        bands[1, :-1, JOINTS] -= stiff_steps
        diagonal = np.arange(blocks.shape[1])
        blocks[:, diagonal, diagonal] += bands[0]
        return BandedMatrix(blocks, bands[1:]), right

    def _curvature(self, point: Point, outward: np.ndarray, multipliers: np.ndarray) -> np.ndarray:
        """What the curvature of the kinematics adds to the Hessian (N, n, n)."""
        functions, forces = self._functions, 2 * point.missed
        forces[:, functions.value_rows] += multipliers + self._parts(outward)[1]
        (curvature,) = functions.curvature(point.x, self._stretch.parameters, forces)
        return curvature.reshape(*point.x.shape, -1)

    def _parts(self, rows: np.ndarray) -> list[np.ndarray]:
        """Rows of the joints (N, J), of the constraint values (N, V), of the steps (N - 1, J)."""
        (frames, values), joints = self._equal.shape, len(self._stretch.step_limit)
        parts = np.split(rows, [frames * joints, frames * (joints + values)])
        widths = (joints, values, joints)
        return [part.reshape(-1, width) for part, width in zip(parts, widths, strict=True)]


def _flat(joints: np.ndarray, values: np.ndarray, steps: np.ndarray) -> np.ndarray:
    return np.concatenate([joints.ravel(), values.ravel(), steps.ravel()])
