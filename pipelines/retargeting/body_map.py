"""Which points of the animal belong to which bodies of the robot, leg by leg."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lacoloco.datasets.mocap import Mocap
from lacoloco.pipelines.errors import StageError
from lacoloco.pipelines.kinematics import FREE_BASE, BodyPositions
from lacoloco.robots.spec import RobotSpec


@dataclass(frozen=True)
class BodyMap:
    """The robot's keypoints split into hips (where legs begin) and feet, one each per leg.

    Legs are in the order of `RobotSpec.feet`.
    """

    hips: tuple[str, ...]
    """Mocap joints at which the limbs begin."""
    feet: tuple[str, ...]
    """Mocap joints that stand for the feet in the paper."""
    hip_columns: tuple[int, ...]
    """Where the hips stand among the robot's keypoints."""
    foot_columns: tuple[int, ...]

    def limb_ends(self, mocap: Mocap) -> tuple[str, ...]:
        """Nodes that touch the ground: the ends below `feet` where the file has them, else `feet`.

        Raises:
            DatasetError: The skeleton lacks a foot.
        """
        mocap.keypoints(self.feet)
        ends = (f"{foot}_end" for foot in self.feet)
        return tuple(
            end if end in mocap.joint_names else foot
            for end, foot in zip(ends, self.feet, strict=True)
        )


@dataclass(frozen=True)
class LegGeometry:
    """Sizes of the robot that scaling needs, in its base frame."""

    hips: np.ndarray
    """(F, 3) where the legs begin, m."""
    feet: np.ndarray
    """(F, 3) the feet below them in the neutral pose, m."""
    reach: float
    """Longest distance between a hip and its foot, m."""


def body_map(spec: RobotSpec) -> BodyMap:
    """Read the pairs of hips and feet off the robot's keypoints.

    Raises:
        StageError: A foot has no keypoint, or no keypoint at the root of its leg.
    """
    model = spec.model()
    joints, bodies = list(spec.keypoints), list(spec.keypoints.values())
    hips, feet = [], []
    for foot in spec.feet:
        chain = [foot]
        while model.body(chain[-1]).parentid[0] != 0:
            chain.append(model.body(model.body(chain[-1]).parentid[0]).name)
        above = [body for body in chain[1:] if body in bodies]
        if foot not in bodies or not above:
            raise StageError(
                f"robot '{spec.name}': retargeting needs keypoints for {foot} and for a body at the"
                " root of its leg; add them to its RobotSpec"
            )
        hips.append(bodies.index(above[-1]))
        feet.append(bodies.index(foot))
    return BodyMap(
        hips=tuple(joints[i] for i in hips),
        feet=tuple(joints[i] for i in feet),
        hip_columns=tuple(hips),
        foot_columns=tuple(feet),
    )


def leg_geometry(spec: RobotSpec, mapping: BodyMap) -> LegGeometry:
    """Measure the robot's legs with its own kinematics."""
    bodies = list(spec.keypoints.values())
    model = spec.pinocchio_model()
    positions = BodyPositions(model, bodies)
    poses = _spread_poses(spec)
    count, upright = len(poses), np.array([1.0, 0.0, 0.0, 0.0])
    assert poses.shape[1] == model.nq - FREE_BASE
    points = positions(np.zeros((count, 3)), np.tile(upright, (count, 1)), poses)
    hips, feet = points[:, mapping.hip_columns], points[:, mapping.foot_columns]
    reach = np.linalg.norm(feet - hips, axis=-1).max()
    return LegGeometry(hips[0], feet[0], float(reach))


def _spread_poses(spec: RobotSpec) -> np.ndarray:
    """The neutral pose, then every joint in turn through a full circle from all joints at zero."""
    angles = np.linspace(-np.pi, np.pi, 73)
    single = np.zeros((spec.num_joints, len(angles), spec.num_joints))
    for joint in range(spec.num_joints):
        single[joint, :, joint] = angles
    return np.concatenate([[spec.retarget_neutral], single.reshape(-1, spec.num_joints)])
