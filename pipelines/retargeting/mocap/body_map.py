"""Which points of the animal belong to which bodies of the robot, leg by leg."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from difflib import get_close_matches

import numpy as np

from lacoloco.datasets.errors import DatasetError
from lacoloco.datasets.mocap import Mocap
from lacoloco.pipelines.errors import StageError
from lacoloco.pipelines.retargeting.forward_kinematics import FREE_BASE, BodyPositions
from lacoloco.robots.spec import RobotSpec

_TYPO = 0.9
"""How alike a misspelt name and the right one are at least, see `difflib`."""


@dataclass(frozen=True)
class BodyMap:
    """The robot's keypoints split into hips (where legs begin) and feet, one each per leg.

    Legs are in the order of `RobotSpec.feet`.
    """

    hips: tuple[str, ...]
    """Mocap joints at which the limbs begin."""
    feet: tuple[str, ...]
    """Mocap joints that stand for the feet in the paper."""
    hip_keypoints: tuple[int, ...]
    """Indices of the hips among the robot's keypoints."""
    foot_keypoints: tuple[int, ...]
    """Indices of the feet among them."""
    ends: tuple[tuple[str, ...], ...]
    """Nodes that touch the ground, per leg: the first that a file has."""

    def limb_ends(self, mocap: Mocap) -> tuple[str, ...]:
        """The node of each leg that touches the ground; its foot where the file has no other.

        Raises:
            DatasetError: The skeleton lacks a foot, or a node that is said to touch the ground.
        """
        mocap.keypoints(self.feet)
        self._check_ends(mocap)
        return tuple(
            next((end for end in ends if end in mocap.joint_names), foot)
            for ends, foot in zip(self.ends, self.feet, strict=True)
        )

    def _check_ends(self, mocap: Mocap) -> None:
        """Refuse a misspelt node: without it another one is taken, and the scale changes."""
        named = {*self.hips, *self.feet, *(end for ends in self.ends for end in ends)}
        others = [joint for joint in mocap.joint_names if joint not in named]
        for ends in self.ends:
            # Files leave out ends of limbs; then those of their joints are meant.
            known = [end for end in ends if end.removesuffix("_end") in mocap.joint_names]
            for end in ends:
                likely = end not in mocap.joint_names and get_close_matches(end, others, 1, _TYPO)
                if likely or not known:
                    mocap.keypoints([end])

    def limbs(self, mocap: Mocap) -> list[tuple[str, ...]]:
        """The nodes of each leg from its hip down to the ground.

        Raises:
            DatasetError: The skeleton lacks a hip or a foot, or one is not below the other.
        """
        mocap.keypoints(self.hips)
        return [
            _chain(mocap, hip, end)
            for hip, end in zip(self.hips, self.limb_ends(mocap), strict=True)
        ]


@dataclass(frozen=True)
class LegGeometry:
    """Sizes of the robot that scaling needs, in its base frame."""

    hips: np.ndarray
    """(F, 3) where the legs begin, m."""
    feet: np.ndarray
    """(F, 3) the feet below them in the neutral pose, m."""
    reach: float
    """Longest distance between a hip and its foot, m."""


def body_map(spec: RobotSpec, contacts: Mapping[str, Sequence[str]] | None = None) -> BodyMap:
    """Read the pairs of hips and feet off the robot's keypoints.

    Args:
        spec: The robot.
        contacts: Per foot of the robot, nodes that touch the ground; default: the end below the
            joint of its keypoint.

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
                " root of its leg; add them to [retargeting.keypoints] of robot.toml"
            )
        hips.append(bodies.index(above[-1]))
        feet.append(bodies.index(foot))
    return BodyMap(
        hips=tuple(joints[i] for i in hips),
        feet=tuple(joints[i] for i in feet),
        hip_keypoints=tuple(hips),
        foot_keypoints=tuple(feet),
        ends=tuple(
            tuple((contacts or {}).get(foot, (f"{joints[i]}_end",)))
            for foot, i in zip(spec.feet, feet, strict=True)
        ),
    )


def side_partners(legs: LegGeometry) -> list[int]:
    """For each leg, the one on the other side of the robot."""
    mirrored = legs.hips * [1.0, -1.0, 1.0]
    distance = np.linalg.norm(mirrored[:, None] - legs.hips[None], axis=-1)
    return distance.argmin(1).tolist()


def leg_geometry(spec: RobotSpec, mapping: BodyMap) -> LegGeometry:
    """Measure the robot's legs with its own kinematics."""
    bodies = list(spec.keypoints.values())
    model = spec.pinocchio_model()
    positions = BodyPositions(model, bodies)
    poses = _spread_poses(spec)
    count, upright = len(poses), np.array([1.0, 0.0, 0.0, 0.0])
    assert poses.shape[1] == model.nq - FREE_BASE
    points = positions(np.zeros((count, 3)), np.tile(upright, (count, 1)), poses)
    hips, feet = points[:, mapping.hip_keypoints], points[:, mapping.foot_keypoints]
    reach = np.linalg.norm(feet - hips, axis=-1).max()
    return LegGeometry(hips[0], feet[0], float(reach))


def _chain(mocap: Mocap, hip: str, end: str) -> tuple[str, ...]:
    """Names from hip to end, going up the parents."""
    names, index = [end], mocap.joint_names.index(end)
    while names[-1] != hip:
        index = mocap.parents[index]
        if index < 0:
            raise DatasetError(f"{mocap.name}: joint '{end}' is not below '{hip}'; mend the map")
        names.append(mocap.joint_names[index])
    return tuple(reversed(names))


def _spread_poses(spec: RobotSpec) -> np.ndarray:
    """The neutral pose, then every joint in turn through a full circle from all joints at zero."""
    angles = np.linspace(-np.pi, np.pi, 73)
    single = np.zeros((spec.num_joints, len(angles), spec.num_joints))
    for joint in range(spec.num_joints):
        single[joint, :, joint] = angles
    return np.concatenate([[spec.retarget_neutral], single.reshape(-1, spec.num_joints)])
