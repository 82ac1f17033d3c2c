"""From one recording to one clip, in either mode."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, Literal, cast

import numpy as np

from lacoloco.datasets.clip import Clip
from lacoloco.datasets.mocap import Mocap
from lacoloco.pipelines.errors import StageError
from lacoloco.pipelines.retargeting.config import Mode
from lacoloco.pipelines.retargeting.filters import lower_envelope
from lacoloco.pipelines.retargeting.forward_kinematics import BodyPositions
from lacoloco.pipelines.retargeting.measure.assessment import Assessment
from lacoloco.pipelines.retargeting.mocap.body_map import body_map, leg_geometry
from lacoloco.pipelines.retargeting.mocap.skeleton_maps import RULES, SkeletonMap
from lacoloco.pipelines.retargeting.solve.clip_problem import ClipProblem, ClipWeights
from lacoloco.pipelines.retargeting.solve.pose_problem import PoseProblem, TrackedMotion
from lacoloco.pipelines.retargeting.targets.targets import (
    ScaleRule,
    Targets,
    fitted_targets,
    plain_targets,
)
from lacoloco.robots.spec import RobotSpec

GROUND_REACH = 0.5
"""s; a clip is set on the ground by its lowest feet within this time, so that leaps stay leaps."""


@dataclass(frozen=True)
class Retargeted:
    """A clip and how good it is."""

    clip: Clip
    assessment: Assessment
    failures: int
    """Frames that the solver could not solve; they are blends of their neighbours."""
    seconds: float
    """Processor time."""

    def metrics(self) -> dict[str, Any]:
        """Name, number of frames, and all that is measured; plain JSON values."""
        return {
            "name": self.clip.name,
            "frames": self.clip.frames,
            **self.assessment.metrics(),
            "solver_failures": self.failures,
        }


class Retargeter:
    """One robot and one kind of skeleton, with their programs, built once for all recordings."""

    def __init__(
        self,
        spec: RobotSpec,
        mode: Mode,
        scale: str,
        posture_weight: float,
        weights: ClipWeights,
        skeleton: SkeletonMap | None = None,
    ) -> None:
        """Build them.

        Args:
            spec: The robot.
            mode: "paper", one program per frame; "clip", one for all frames.
            scale: See `parse_scale`; "" for what suits the mode.
            posture_weight: Of the paper's program.
            weights: Of the clip's program.
            skeleton: Its joints; default: the keypoints of the robot's own spec.

        Raises:
            StageError: The robot cannot be retargeted to, or the scale is none.
        """
        self.spec = spec = spec if skeleton is None else mapped(spec, skeleton)
        self._scale = parse_scale(scale or ("none" if mode == "paper" else "auto"))
        if mode == "clip" and self._scale is None:
            raise StageError(
                "scale 'none': feet cannot be planted so; use auto, a factor, or paper mode"
            )
        self._rule: ScaleRule = "limbs"
        if skeleton is not None and self._scale == "auto":
            if skeleton.scale in RULES:
                self._rule = cast(ScaleRule, skeleton.scale)
            else:
                self._scale = float(skeleton.scale)
        self._poses = PoseProblem(spec, posture_weight)
        self.map = body_map(spec, None if skeleton is None else skeleton.contacts)
        self.limb = 0.0 if skeleton is None else skeleton.limb
        self.legs = leg_geometry(spec, self.map)
        self._clips = None
        if mode == "clip":
            self._clips = ClipProblem(spec, self.map, self.legs, weights)
        located = spec.located((*spec.keypoints.values(), *spec.foot_points))
        self._positions = BodyPositions(spec.pinocchio_model(), *located)
        self._radius = spec.foot_radius()

    def clip(
        self,
        mocap: Mocap,
        name: str,
        *,
        on_frame: Callable[[int], None] = lambda done: None,
        skill: str = "",
        source: str = "",
        licence: str = "",
    ) -> Retargeted:
        """Retarget one recording.

        Args:
            mocap: The recording.
            name: Name of the clip.
            on_frame: Told the number of frames done.
            skill: Of the clip.
            source: Name of the file that it was made from.
            licence: Of that file.

        Raises:
            DatasetError: The skeleton lacks a joint.
            StageError: No frame could be solved.
        """
        started = time.process_time()
        targets = self._targets(mocap)
        motion, lift, failures = self._solve(targets, mocap.fps, on_frame)
        seconds = time.process_time() - started
        points = self._positions(motion.root_pos, motion.root_quat, motion.joint_pos)
        keypoints, feet = np.split(points, [len(self.spec.keypoints)], axis=1)
        clip = Clip.from_poses(
            name,
            mocap.fps,
            self.spec.joint_names,
            motion.root_pos + lift,
            motion.root_quat,
            motion.joint_pos,
            contacts=self.map.standing(targets.contacts),
            skill=skill,
            source=source,
            licence=licence,
        )
        assessment = Assessment(
            spec=self.spec,
            clip=clip,
            targets=targets,
            keypoints=keypoints,
            feet=feet + lift[:, None],
            hip_keypoints=self.map.hip_keypoints,
            lift=lift[:, 2],
        )
        return Retargeted(clip, assessment, failures, seconds)

    def _targets(self, mocap: Mocap) -> Targets:
        if self._scale is None:
            return plain_targets(mocap, self.map)
        factor = None if self._scale == "auto" else self._scale
        return fitted_targets(mocap, self.map, self.legs, self._radius, factor, self._rule)

    def _solve(
        self, targets: Targets, fps: float, on_frame: Callable[[int], None]
    ) -> tuple[TrackedMotion, np.ndarray, int]:
        """Motion, lift (T, 3) onto the ground, and number of frames without a solution."""
        if self._clips is not None:
            motion = self._clips.track(targets, fps, on_frame)
            lift = np.zeros_like(motion.root_pos)
        else:
            motion = self._poses.track(targets.points, on_frame)
            points = self._positions(motion.root_pos, motion.root_quat, motion.joint_pos)
            lift = ground_lift(points[:, len(self.spec.keypoints) :, 2], self._radius, fps)
        return motion, lift, int(motion.failed.sum())


def mapped(spec: RobotSpec, skeleton: SkeletonMap) -> RobotSpec:
    """The robot with the keypoints of a map.

    Raises:
        StageError: The map names a frame that the robot has not, or contacts of heels and toes.
    """
    if spec.soles and skeleton.contacts:
        raise StageError(
            f"map '{skeleton.name}': leave [contacts] out; {spec.name} stands on heels and toes,"
            f" and [keypoints] gives them joints: {', '.join(spec.foot_points)}"
        )
    model = spec.model()
    known = {model.body(index).name for index in range(1, model.nbody)} | set(spec.points)
    for key, frames in (
        ("keypoints", skeleton.keypoints.values()),
        ("contacts", skeleton.contacts),
    ):
        for frame in frames:
            if frame not in known or (key == "contacts" and frame not in spec.foot_points):
                allowed = spec.foot_points if key == "contacts" else sorted(known)
                raise StageError(
                    f"map '{skeleton.name}': [{key}] names '{frame}', which {spec.name} has not;"
                    f" use {', '.join(allowed)}"
                )
    return replace(spec, keypoints=skeleton.keypoints)


def parse_scale(text: str) -> float | Literal["auto"] | None:
    """Read a scale: None for "none", "auto", or a positive factor.

    Raises:
        StageError: It is something else.
    """
    if text in ("none", "auto"):
        return None if text == "none" else "auto"
    try:
        factor = float(text)
    except ValueError:
        factor = 0.0
    if not 1e-4 <= factor <= 1e4:
        raise StageError(f"scale '{text}': use none, auto or a factor from 0.0001 to 10,000")
    return factor


def ground_lift(feet_height: np.ndarray, radius: float, fps: float) -> np.ndarray:
    """Shift (T, 3) that sets a clip on the ground as a whole.

    The paper moves every frame until its lowest foot touches, which deletes all flight and shakes
    the base. Here the shift follows the lowest feet of the surrounding second, smoothly, and never
    leaves a foot in the ground.

    Args:
        feet_height: (T, F) heights of the centres of the foot spheres, m.
        radius: Of the spheres, m.
        fps: Frames per second.
    """
    lowest = lower_envelope(feet_height.min(1), max(int(GROUND_REACH * fps), 1))
    return np.stack([0 * lowest, 0 * lowest, radius - lowest], axis=1)
