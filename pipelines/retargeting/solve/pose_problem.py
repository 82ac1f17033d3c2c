"""The paper's retargeting: one small nonlinear program per frame, built once and warm-started.

    min_q  sum_k |p_k(q) - target_k|^2 + alpha |q_joints - q_neutral|^2
    s.t.   joint limits,  knee heights >= 0                      (paper, "Dog Motion Dataset")

The orientation is a turn by modified Rodrigues parameters on top of that of the frame before: three
numbers without a singularity however often the animal turns around, and a rational function, which
keeps the exact Hessian short.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np

from lacoloco.datasets import rotations
from lacoloco.pipelines.errors import StageError
from lacoloco.pipelines.retargeting import forward_kinematics as kinematics
from lacoloco.pipelines.retargeting.alignment import rigid_fit
from lacoloco.pipelines.retargeting.solve.solver import COLD, WARM, Program, Solution, Solver
from lacoloco.robots.spec import RobotSpec

POSITION, TURN, JOINTS = slice(0, 3), slice(3, 6), slice(6, None)
"""Parts of the variables of one frame."""

JUMP = 0.2
"""rad by which a joint misses where it was going, from which the frame counts as a jump."""
CHECKED = 240
"""Frames between those that are solved from other starts."""
BETTER = 1e-8
"""m^2 from which a cost counts as lower."""


@dataclass(frozen=True)
class TrackedMotion:
    """Configurations found for T frames."""

    root_pos: np.ndarray
    """(T, 3) world, m."""
    root_quat: np.ndarray
    """(T, 4) wxyz, base to world."""
    joint_pos: np.ndarray
    """(T, J) rad."""
    cost: np.ndarray
    """(T,) m^2 at the solution; NaN where the solver failed."""

    @property
    def failed(self) -> np.ndarray:
        """(T,) bool: no solution was found; the pose is the next best, made from its neighbours."""
        return np.isnan(self.cost)


def retarget_bounds(spec: RobotSpec) -> tuple[np.ndarray, np.ndarray]:
    """Joint bounds (J,) each, rad: those of the retargeting within those of the model."""
    lower, upper = spec.joint_limits()
    return np.maximum(lower, spec.retarget_lower), np.minimum(upper, spec.retarget_upper)


class PoseProblem:
    """The program of one frame, and how a clip runs through it."""

    def __init__(self, spec: RobotSpec, posture_weight: float = 0.005) -> None:
        """Build the program and its two solvers, for a close guess and for any.

        Args:
            spec: Robot with `keypoints`.
            posture_weight: alpha of the paper.

        Raises:
            StageError: The robot has no keypoints.
        """
        if not spec.keypoints:
            raise StageError(f"robot '{spec.name}' has no keypoints; add them to its RobotSpec")
        self._neutral = np.array(spec.retarget_neutral)
        spread = np.random.default_rng(0).normal(0.0, 0.5, (1, spec.num_joints))
        self._shifts = [np.zeros(spec.num_joints), *spread]
        located = spec.located(spec.keypoints.values())
        positions = kinematics.BodyPositions(spec.pinocchio_model(), *located)
        upright = np.array([[1.0, 0.0, 0.0, 0.0]])
        self._neutral_points = positions(np.zeros((1, 3)), upright, self._neutral[None])[0]
        program = pose_program(spec, posture_weight)
        self._warm, self._cold = Solver(program, WARM), Solver(program, COLD)

    def track(
        self, targets: np.ndarray, on_frame: Callable[[int], None] = lambda done: None
    ) -> TrackedMotion:
        """Follow targets through a clip, each frame from where the frames before it lead.

        A minimum that is followed may be overtaken by another one before it ends in a jump. So what
        a jump leads to is followed back in time, and what precedes it onward, as far as it is
        better; now and then a frame is solved from elsewhere, too.

        Args:
            targets: (T, K, 3) m, in the order of the robot's keypoints.
            on_frame: Told the number of frames done.

        Raises:
            StageError: The solver failed in every frame.
        """
        found: list[Solution | None] = []
        quats = np.full((len(targets), 4), np.nan)
        earlier: Solution | None = None
        before: Solution | None = None
        for index, target in enumerate(targets):
            if before is None:
                guess, quat = self._neutral_guess(target)
            else:
                guess = _continued(before.variables, None if earlier is None else earlier.variables)
            solution = self._solve(target, guess, quat, before)
            if solution is not None:
                quat = quats[index] = _turned(quat, solution.variables[TURN])
            earlier, before = before, solution
            found.append(solution)
            on_frame(index + 1)
        for frame in (*_jumps(found), *self._from_elsewhere(targets, found, quats)):
            for way in (-1, 1):
                self._spread(targets, found, quats, frame, way)
        return _motion(found, quats)

    def _from_elsewhere(
        self, targets: np.ndarray, found: list[Solution | None], quats: np.ndarray
    ) -> Iterator[int]:
        """Solve some frames from other starts; gives those where that is better."""
        frames = range(0, len(targets), CHECKED)
        for frame in sorted({*frames, len(targets) - 1}):
            for shift in self._shifts:
                guess, quat = self._neutral_guess(targets[frame])
                guess[JOINTS] += shift
                parameters = np.concatenate([quat, targets[frame].ravel()])
                if self._improve(found, quats, frame, self._cold.solve(guess, parameters), quat):
                    yield frame

    def _spread(
        self,
        targets: np.ndarray,
        found: list[Solution | None],
        quats: np.ndarray,
        frame: int,
        way: int,
    ) -> None:
        """Follow the solution of a frame forth (1) or back (-1) while it is better."""
        better, near = True, found[frame]
        while better and near is not None and 0 <= frame + way < len(targets):
            quat = quats[frame]
            frame += way
            parameters = np.concatenate([quat, targets[frame].ravel()])
            guess = _continued(near.variables, None)
            better = self._improve(
                found, quats, frame, self._warm.solve(guess, parameters, near), quat
            )
            near = found[frame]

    def _improve(
        self,
        found: list[Solution | None],
        quats: np.ndarray,
        frame: int,
        solution: Solution | None,
        quat: np.ndarray,
    ) -> bool:
        """Take a solution on top of `quat` where it is better than what was found."""
        before = found[frame]
        if solution is None or before is None or solution.cost > before.cost - BETTER:
            return False
        found[frame], quats[frame] = solution, _turned(quat, solution.variables[TURN])
        return True

    def _solve(
        self, target: np.ndarray, guess: np.ndarray, quat: np.ndarray, near: Solution | None
    ) -> Solution | None:
        parameters = np.concatenate([quat, target.ravel()])
        warm = self._warm.solve(guess, parameters, near)
        return warm or self._cold.solve(np.r_[guess[:6], self._neutral], parameters)

    def neutral_pose(self, target: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Position (3,), quaternion (4,) and joints (J,) of the neutral pose, moved to a target."""
        position, quat = rigid_fit(self._neutral_points, target[None])
        return position[0], quat[0], self._neutral

    def _neutral_guess(self, target: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        position, quat, joints = self.neutral_pose(target)
        return np.concatenate([position, np.zeros(3), joints]), quat


def pose_program(spec: RobotSpec, posture_weight: float) -> Program:
    """The program of one frame; parameters are the quaternion before the turn and the targets.

    The targets (K, 3), m, are in the order of the robot's keypoints, row after row.
    """
    model, joints = spec.pinocchio_model(), spec.num_joints
    variables = ca.SX.sym("variables", 6 + joints)
    reference, targets = ca.SX.sym("reference", 4), ca.SX.sym("targets", 3, len(spec.keypoints))
    quat = kinematics.multiply(reference, kinematics.small_rotation(variables[TURN]))
    base = kinematics.SymbolicPose(kinematics.rotation_of(quat), variables[POSITION])
    poses = kinematics.body_poses(model, base, variables[JOINTS])
    located = zip(*spec.located(spec.keypoints.values()), strict=True)
    points = (kinematics.body_position(model, poses, *point) for point in located)
    cost = ca.sumsqr(ca.horzcat(*points) - targets)
    cost += posture_weight * ca.sumsqr(variables[JOINTS] - ca.DM(spec.retarget_neutral))
    knees = [kinematics.body_position(model, poses, body)[2] for body in spec.knee_frames]
    lower, upper = retarget_bounds(spec)
    free = np.full(6, np.inf)
    return Program(
        variables=variables,
        parameters=ca.vertcat(reference, ca.vec(targets)),
        cost=cost,
        constraints=ca.vertcat(*knees),
        variable_bounds=(np.r_[-free, lower], np.r_[free, upper]),
        constraint_bounds=(np.zeros(len(knees)), np.full(len(knees), np.inf)),
    )


def _continued(now: np.ndarray, before: np.ndarray | None) -> np.ndarray:
    """Guess of the next frame at constant velocity; its turn is on top of the pose of `now`."""
    if before is None:
        return np.concatenate([now[POSITION], np.zeros(3), now[JOINTS]])
    guess = 2 * now - before
    guess[TURN] = now[TURN]
    return guess


def _jumps(found: Sequence[Solution | None]) -> list[int]:
    """Frames before and after which a joint goes elsewhere than it was about to."""
    known = [solution.variables[JOINTS] for solution in found if solution is not None]
    if len(known) < max(len(found), 3):
        return []  # a frame without a solution is a gap, and blended
    change = np.abs(np.diff(np.array(known), 2, axis=0)).max(1)
    return sorted({int(f) + k for f in np.flatnonzero(change > JUMP) for k in (0, 1, 2)})


def _turned(quat: np.ndarray, turn: np.ndarray) -> np.ndarray:
    """Numeric twin of the turn in the program, (4,), unit; in plain floats, once per frame."""
    w, x, y, z = quat.tolist()
    a, b, c = turn.tolist()
    square = a * a + b * b + c * c
    e, a, b, c = 1 - square, 2 * a, 2 * b, 2 * c
    product = np.array(
        [
            w * e - x * a - y * b - z * c,
            w * a + x * e + y * c - z * b,
            w * b - x * c + y * e + z * a,
            w * c + x * b - y * a + z * e,
        ]
    )
    return product / np.sqrt(product @ product)


def _motion(found: list[Solution | None], quats: np.ndarray) -> TrackedMotion:
    solutions = [solution for solution in found if solution is not None]
    solved = np.flatnonzero([solution is not None for solution in found])
    if not solutions:
        raise StageError("the solver found no pose in any frame; check the scale of the motion")
    frames = np.arange(len(found))
    variables = np.array([solution.variables for solution in solutions])
    columns = [np.interp(frames, solved, column) for column in variables.T]
    cost = np.full(len(found), np.nan)
    cost[solved] = [solution.cost for solution in solutions]
    return TrackedMotion(
        root_pos=np.stack(columns[POSITION], axis=1),
        root_quat=_interpolated(frames, solved, quats[solved]),
        joint_pos=np.stack(columns[JOINTS], axis=1),
        cost=cost,
    )


def _interpolated(frames: np.ndarray, known: np.ndarray, quats: np.ndarray) -> np.ndarray:
    after = np.clip(np.searchsorted(known, frames), 0, len(known) - 1)
    before = np.clip(np.searchsorted(known, frames, side="right") - 1, 0, None)
    span = np.maximum(known[after] - known[before], 1)
    return rotations.slerp(quats[before], quats[after], (frames - known[before]) / span)
