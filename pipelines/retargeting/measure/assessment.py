"""A retargeted clip beside what it was to follow: from here come its metrics and its picture."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from lacoloco.datasets.clip import Clip
from lacoloco.pipelines.retargeting.findings import Finding
from lacoloco.pipelines.retargeting.measure import quality
from lacoloco.pipelines.retargeting.measure.inverse_dynamics import Efforts, inverse_dynamics
from lacoloco.pipelines.retargeting.solve.pose_problem import retarget_bounds
from lacoloco.pipelines.retargeting.targets.targets import Targets
from lacoloco.robots.collisions import Penetrations, find_penetrations
from lacoloco.robots.spec import RobotSpec

DEEP = 3e-3
"""m of a body in the floor, or of two in each other, from which it is said."""
FEW_STAND = 0.5
"""Share of the frames with a foot down below which nothing is said to stand. A gallop has 0.73."""
MUCH_MISSING = 0.5
"""Median share of the weight above which the ground is said not to carry the motion."""


@dataclass(frozen=True)
class Assessment:
    """T frames of a clip, in place on the ground, and the targets they were solved for."""

    spec: RobotSpec
    clip: Clip
    targets: Targets
    keypoints: np.ndarray
    """(T, K, 3) world, m, as solved: where they are compared with the targets."""
    feet: np.ndarray
    """(T, P, 3) centres of the spheres that feet stand on in the clip, world, m."""
    hip_keypoints: tuple[int, ...]
    """Indices of the hips among the keypoints."""
    lift: np.ndarray
    """(T,) m by which the clip stands higher than what was solved."""

    @property
    def contacts(self) -> np.ndarray:
        """(T, P) bool, which points of the robot's feet touch the ground."""
        return quality.touches(self.feet, self.spec.foot_radius())

    @cached_property
    def courses(self) -> tuple[np.ndarray, np.ndarray]:
        """(T, 3) the middle of the hips, of the robot and of the animal in the robot's size, m."""
        hips, up = list(self.hip_keypoints), np.array([0.0, 0.0, 1.0])
        lift = self.lift[:, None] * up
        robot, animal = self.keypoints[:, hips], self.targets.points[:, hips]
        return robot.mean(1) + lift, animal.mean(1) + lift

    @cached_property
    def efforts(self) -> Efforts:
        """What the motion would take; the ground pushes where the clip says that a foot stands."""
        return inverse_dynamics(self.spec, self.clip, self.targets.contacts)

    @cached_property
    def torque_share(self) -> np.ndarray:
        """(T, J) torques relative to the motors' limits."""
        return np.abs(self.efforts.torques) / self.spec.effort_limits()

    @cached_property
    def penetrations(self) -> Penetrations:
        """How deep bodies that are no feet lie in the floor, and bodies in each other."""
        clip = self.clip
        qpos = np.concatenate([clip.root_pos, clip.root_quat, clip.joint_pos], axis=1)
        return find_penetrations(self.spec, qpos, DEEP)

    def findings(self) -> list[Finding]:
        """What the metrics say that a person should know."""
        found, frames = [], self.clip.frames
        share = float(self.targets.contacts.any(axis=1).mean())
        missing = float(np.median(self.efforts.missing) / self.spec.weight())
        if share < FEW_STAND:
            text = (
                f"a foot stands in {share:.0%} of the frames only: does the floor tilt, or does the"
                " root not move?"
            )
            found.append(Finding("nothing_stands", text))
        elif missing > MUCH_MISSING:
            text = (
                f"standing feet cannot carry {missing:.0%} of the weight: at the robot's size the"
                " motion is faster than gravity"
            )
            found.append(Finding("not_carried", text))
        depths = self.penetrations
        for name, where, what in (
            ("body_contact", depths.floor, f"{', '.join(depths.floor_bodies)} in the floor"),
            ("self_contact", depths.own, f"{', '.join(depths.own_pairs)} in each other"),
        ):
            count = int((where > DEEP).sum())
            if count:
                text = f"{what} by up to {1e3 * where.max():.0f} mm in {count} of {frames} frames"
                found.append(Finding(name, text))
        return found

    def metrics(self) -> dict[str, Any]:
        """All metrics of the clip, plain JSON values."""
        spec, fps = self.spec, self.clip.fps
        speed_limits = np.array(spec.velocity_limits)
        bounds = retarget_bounds(spec)
        missing = self.efforts.missing / spec.weight()
        return {
            "scale": self.targets.scale,
            **quality.keypoint_errors(self.keypoints, self.targets.points),
            **quality.foot_quality(self.feet, self.targets.contacts, spec.foot_radius(), fps),
            **quality.joint_quality(self.clip.joint_pos, bounds, speed_limits, fps),
            **quality.course_quality(*self.courses, fps),
            **quality.effort_quality(self.torque_share, missing),
            "body_penetration_max_m": float(self.penetrations.floor.max()),
            "self_penetration_max_m": float(self.penetrations.own.max()),
        }
