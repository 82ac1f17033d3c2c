"""Retargeting of whole clips: feet planted where the paws stand, everything else as close and
smooth.

The clip is one sparse program (clips of many minutes: overlapping stretches of one), solved first
on every few frames and then on all of them.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Annotated

import numpy as np

from lacoloco.datasets import rotations
from lacoloco.datasets.config_values import Factor, Within
from lacoloco.pipelines.retargeting.alignment import rigid_fit
from lacoloco.pipelines.retargeting.filters import smooth
from lacoloco.pipelines.retargeting.measure.quality import LIMIT_MARGIN
from lacoloco.pipelines.retargeting.mocap.body_map import BodyMap, LegGeometry
from lacoloco.pipelines.retargeting.solve.frame_functions import FrameFunctions
from lacoloco.pipelines.retargeting.solve.leg_reach import mend, reach
from lacoloco.pipelines.retargeting.solve.pose_problem import (
    JOINTS,
    POSITION,
    TURN,
    TrackedMotion,
    retarget_bounds,
)
from lacoloco.pipelines.retargeting.solve.stretch_solver import solve_stretch
from lacoloco.pipelines.retargeting.targets.foot_plan import FootPlan, footprints, plan_feet
from lacoloco.pipelines.retargeting.targets.stretch import Stretch
from lacoloco.pipelines.retargeting.targets.targets import Targets
from lacoloco.robots.spec import RobotSpec

COARSE = 10.0
"""frames/s of the first solution."""
LONGEST, LOOK_AHEAD, KEPT = 2000, 60, 3
"""Frames of a stretch; beyond its end that are solved with it; at its start that are fixed."""
SHORTEST = 90
"""Frames; a shorter stretch is not halved when it does not converge."""
SPEED_SHARE = 0.98
"""Share of the motors' speed that is used."""
STRAIGHTEST, TIGHTEST = 0.1, 2.9
"""rad between which a knee bends; it never changes sides."""


@dataclass(frozen=True)
class ClipWeights:
    """What a clip's program weighs against the squared distances of its keypoints, m^2.

    Smoothness is the square of third differences at 60 frames/s; other rates are converted.

    Attributes:
        posture: Per joint and squared distance from the neutral pose, m^2/rad^2. A tenth of the
            paper's: a strong pull to the neutral pose drags feet that swing off their way, and
            they would have to jump to where they are planted.
        smooth_position: Of the base, per m^2.
        smooth_turn: Of the base, m^2/rad^2.
        smooth_joints: Of each joint, m^2/rad^2.
        knee_height: Least height of the knees, m: their radius.
        hip_height: Least height of the hips, m: half of the base's and of the thigh's thickness.
    """

    posture: Factor = 5e-4
    smooth_position: Factor = 50.0
    smooth_turn: Factor = 5.0
    smooth_joints: Factor = 0.5
    knee_height: Annotated[float, Within(0, 10)] = 0.02
    hip_height: Annotated[float, Within(0, 10)] = 0.045


class ClipProblem:
    """One robot's problem, for clips of any length and rate."""

    def __init__(
        self, spec: RobotSpec, mapping: BodyMap, legs: LegGeometry, weights: ClipWeights
    ) -> None:
        """Derive the functions of a frame."""
        self._spec, self._map, self._legs, self._weights = spec, mapping, legs, weights
        self._radius = spec.foot_radius()
        self._functions = FrameFunctions(spec, mapping, weights.posture)
        self._limits = _joint_limits(spec)
        smooth_joints = np.full(spec.num_joints, weights.smooth_joints)
        smooth_base = np.repeat([weights.smooth_position, weights.smooth_turn], 3)
        self._smoothness = np.concatenate([smooth_base, smooth_joints])

    def track(
        self, targets: Targets, fps: float, on_frame: Callable[[int], None] = lambda done: None
    ) -> TrackedMotion:
        """Solve a clip.

        A stretch that does not converge is halved; what is left of it in the end keeps the guess,
        a smooth trunk on legs that reach for their feet, between neighbours that were solved.

        Args:
            targets: What to follow.
            fps: Frames per second.
            on_frame: Told the number of frames done.

        Returns:
            The motion; `failed` where it is the guess.
        """
        clip = self._stretch(targets, fps)
        done, failed = np.empty_like(clip.guess), np.zeros(len(clip.guess), dtype=bool)
        starts = range(0, len(done), LONGEST)
        pending = [(start, min(start + LONGEST, len(done))) for start in reversed(starts)]
        while pending:
            start, stop = pending.pop()
            first = max(start - KEPT, 0)
            part = _part(clip, first, min(stop + LOOK_AHEAD, len(done)), done[first:start])
            solution = self._solve(part, fps)
            if solution is None and stop - start > SHORTEST:
                middle = (start + stop) // 2
                pending += [(middle, stop), (start, middle)]
                continue
            if solution is None:
                solution, failed[start:stop] = part.guess, True
            done[start:stop] = solution[start - first : stop - first]
            on_frame(stop)
        done = mend(self._functions, done, clip)
        cost = self._functions.cost(done, clip.parameters)
        quat = rotations.multiply(clip.parameters[:, :4], _turn_quaternion(done[:, TURN]))
        cost[failed] = np.nan
        return TrackedMotion(done[:, POSITION], quat, done[:, JOINTS], cost)

    def _solve(self, stretch: Stretch, fps: float) -> np.ndarray | None:
        """Solve every few frames, which finds the way, and then all of them."""
        stride = _stride(fps)
        if stride > 1 and len(stretch.guess) > 4 * stride:
            coarse = stretch.sampled(stride)
            smoothness = self._smoothness_at(fps / stride)
            found = solve_stretch(self._functions, coarse, smoothness, rough=True)
            if found is not None:
                stretch = replace(stretch, guess=_interpolated(found, stride, len(stretch.guess)))
        return solve_stretch(self._functions, stretch, self._smoothness_at(fps))

    def _smoothness_at(self, fps: float) -> np.ndarray:
        """Weights of squared third differences, which shrink with the cube of the frame's time."""
        return self._smoothness * (fps / 60.0) ** 6

    def _stretch(self, targets: Targets, fps: float) -> Stretch:
        """The whole clip: guess, targets and bounds."""
        feet = targets.points[:, self._map.foot_keypoints]
        prints = footprints(feet, targets.contacts) if self._map.soles else None
        plan = plan_feet(feet, targets.contacts, self._radius, fps, prints)
        points = targets.points.copy()
        points[:, self._map.foot_keypoints] = plan.path
        guess, reference = self._guess(points, plan, fps)
        frames = len(points)
        lower, upper = self._limits
        free = np.full((frames, 6), np.inf)
        return Stretch(
            guess=guess,
            parameters=np.concatenate([reference, points.reshape(frames, -1)], axis=1),
            variable_bounds=(
                np.concatenate([-free, np.tile(lower, (frames, 1))], axis=1),
                np.concatenate([free, np.tile(upper, (frames, 1))], axis=1),
            ),
            value_bounds=self._value_bounds(plan),
            step_limit=SPEED_SHARE * np.array(self._spec.velocity_limits) / fps,
        )

    def _guess(
        self, points: np.ndarray, plan: FootPlan, fps: float
    ) -> tuple[np.ndarray, np.ndarray]:
        """Variables (T, n) and reference orientations (T, 4): a trunk that fits, legs that reach.

        An animal that sits has its hips where the robot's knees would be in the ground; from a
        guess like that there is no way out, so the hips begin higher.
        """
        trunk = points[:, self._map.trunk].copy()
        trunk[..., 2] = np.maximum(trunk[..., 2], 0.5 * self._legs.reach)
        position, quat = rigid_fit(self._legs.points[list(self._map.trunk)], trunk)
        reference = rotations.normalize(smooth(rotations.continuous(quat), 0.05 * fps))
        base = np.concatenate([position, np.zeros_like(position)], axis=1)
        feet, stride = plan.path.reshape(len(points), -1), _stride(fps)
        neutral = np.tile(self._spec.retarget_neutral, (len(base[::stride]), 1))
        few = (part[::stride] for part in (base, reference, feet))
        joints = reach(self._functions, self._limits, neutral, *few, steps=12)
        joints = _interpolated(joints, stride, len(points))
        joints = reach(self._functions, self._limits, joints, base, reference, feet, steps=3)
        return np.concatenate([base, joints], axis=1), reference

    def _value_bounds(self, plan: FootPlan) -> tuple[np.ndarray, np.ndarray]:
        """Feet that stand are planted; feet that swing, knees and hips stay above their floor."""
        functions, weights, frames = self._functions, self._weights, len(plan.path)
        lower = np.full((frames, len(functions.value_rows)), -np.inf)
        upper = np.full_like(lower, np.inf)
        floor = np.full_like(plan.path, -np.inf)
        floor[..., 2] = plan.floor
        stands = plan.stands[..., None]
        lower[:, functions.feet] = np.where(stands, plan.path, floor).reshape(frames, -1)
        upper[:, functions.feet] = np.where(stands, plan.path, np.inf).reshape(frames, -1)
        heights = [weights.knee_height] * functions.knees + [weights.hip_height] * functions.hips
        lower[:, functions.heights] = heights
        return lower, upper


def _stride(fps: float) -> int:
    """Every how many frames the first solution has one."""
    return max(round(fps / COARSE), 1)


def _interpolated(values: np.ndarray, stride: int, frames: int) -> np.ndarray:
    """Values (frames, n) of all frames from those of every so many; the last ones are kept."""
    every = np.arange(frames)
    columns = [np.interp(every, every[::stride], column) for column in values.T]
    return np.stack(columns, axis=1)


def _part(clip: Stretch, start: int, stop: int, kept: np.ndarray) -> Stretch:
    """Frames of a clip, the first of them held where they were found before."""
    lower, upper = (bound[start:stop].copy() for bound in clip.variable_bounds)
    guess = clip.guess[start:stop].copy()
    lower[: len(kept)] = upper[: len(kept)] = guess[: len(kept)] = kept
    lower_values, upper_values = (bound[start:stop].copy() for bound in clip.value_bounds)
    lower_values[: len(kept)], upper_values[: len(kept)] = -np.inf, np.inf
    return replace(
        clip,
        guess=guess,
        parameters=clip.parameters[start:stop],
        variable_bounds=(lower, upper),
        value_bounds=(lower_values, upper_values),
    )


def _joint_limits(spec: RobotSpec) -> tuple[np.ndarray, np.ndarray]:
    """Bounds of the joints (J,), a little inside their limits; knees keep the side of neutral."""
    lower, upper = retarget_bounds(spec)
    lower, upper = lower + 2 * LIMIT_MARGIN, upper - 2 * LIMIT_MARGIN
    model = spec.model()
    for body in spec.knee_frames:
        joint = model.body(body).jntadr[0] - 1  # the free joint of the base is the first
        side = np.sign(spec.retarget_neutral[joint])
        near, far = sorted((side * STRAIGHTEST, side * TIGHTEST))
        lower[joint], upper[joint] = max(lower[joint], near), min(upper[joint], far)
    return lower, upper


def _turn_quaternion(turn: np.ndarray) -> np.ndarray:
    """Quaternions (T, 4) of the turns (T, 3), as the functions of a frame read them."""
    parameters = turn / 4  # modified Rodrigues parameters
    square = (parameters**2).sum(1, keepdims=True)
    return np.concatenate([1 - square, 2 * parameters], axis=1) / (1 + square)
