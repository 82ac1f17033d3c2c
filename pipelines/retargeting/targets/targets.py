"""Where the robot's keypoints should be: the animal's as they are (paper), or fitted to the robot.

Fitting keeps the motion and drops what is only anatomy. Sizes shrink by one factor, so that the
legs bend as the animal's do; the hips become the robot's (a dog's are half as far apart); each foot
keeps its place relative to its hip, but below the hip of the robot; and a paw that stands puts the
robot's foot sphere on the ground, however high its marker was.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from lacoloco.datasets import rotations
from lacoloco.datasets.mocap import Mocap
from lacoloco.pipelines.retargeting.alignment import rigid_fit
from lacoloco.pipelines.retargeting.filters import smooth
from lacoloco.pipelines.retargeting.mocap.body_map import BodyMap, LegGeometry
from lacoloco.pipelines.retargeting.targets.contacts import (
    ContactRule,
    detect_contacts,
    stance_heights,
)

ScaleRule = Literal["limbs", "height"]

HEADING_SIGMA = 0.15
"""s; the offsets of the feet turn with the walk, not with every sway of the hips."""
MOST_STRETCHED = 0.9
"""Share of the robot's reach that a standing leg may take after scaling."""


@dataclass(frozen=True)
class Targets:
    """What the robot's keypoints follow through one clip."""

    points: np.ndarray
    """(T, K, 3) world, m, in the order of the robot's keypoints."""
    contacts: np.ndarray
    """(T, F) bool, which of the animal's paws stand, in the order of the robot's feet."""
    scale: float
    """Size of the robot's motion relative to the animal's."""


def plain_targets(mocap: Mocap, joints: tuple[str, ...], mapping: BodyMap) -> Targets:
    """The animal's keypoints unchanged, as in the paper.

    Args:
        mocap: Motion.
        joints: Its joints in the order of the robot's keypoints.
        mapping: Hips and feet among them.

    Raises:
        DatasetError: The skeleton lacks one of them.
    """
    points = mocap.keypoints(joints)
    return Targets(points, paw_contacts(mocap, mapping), 1.0)


def fitted_targets(
    mocap: Mocap,
    mapping: BodyMap,
    legs: LegGeometry,
    foot_radius: float,
    scale: float | None = None,
    rule: ScaleRule = "limbs",
) -> Targets:
    """Keypoints fitted to the robot, see the module.

    Args:
        mocap: Motion.
        mapping: Hips and feet of animal and robot.
        legs: Sizes of the robot.
        foot_radius: m.
        scale: Size of the robot's motion relative to the animal's; None for `natural_scale`.
        rule: Of `natural_scale`.

    Raises:
        DatasetError: The skeleton lacks a joint.
    """
    hips, paws = mocap.keypoints(mapping.hips), mocap.keypoints(mapping.limb_ends(mocap))
    ground = stance_heights(paws, ContactRule())
    if scale is None:
        scale = natural_scale(mocap, mapping, legs, foot_radius, rule)
    center, quat = rigid_fit(legs.hips, scale * hips)
    trunk = center[:, None] + rotations.rotate(quat[:, None], legs.hips[None])
    trunk[..., 2] += foot_radius - scale * ground.mean()

    heading = _heading(quat, mocap.fps)
    flat_hips = scale * hips - center[:, None]
    own = np.median(rotations.rotate_inverse(heading[:, None], flat_hips), axis=0)
    offset = rotations.rotate(heading[:, None], (legs.feet - own)[None])
    feet = scale * paws + offset
    feet[..., 2] = scale * np.maximum(paws[..., 2] - ground, 0.0) + foot_radius

    points = np.empty((mocap.frames, len(mapping.hips) + len(mapping.feet), 3))
    points[:, mapping.hip_keypoints], points[:, mapping.foot_keypoints] = trunk, feet
    return Targets(points, paw_contacts(mocap, mapping), scale)


def natural_scale(
    mocap: Mocap,
    mapping: BodyMap,
    legs: LegGeometry,
    foot_radius: float,
    rule: ScaleRule = "limbs",
) -> float:
    """Size of the robot's motion relative to the animal's.

    By limbs: length of the robot's legs over that of the animal's limbs, so that both bend alike;
    less when the animal's hips stand so high above its paws that the robot's legs would stretch.
    By height: as large as legs reach, for limbs whose bones say little (a horse's, an arthropod's).
    """
    reach = legs.reach + foot_radius
    paws = mocap.keypoints(mapping.limb_ends(mocap))
    height = (mocap.keypoints(mapping.hips)[..., 2] - stance_heights(paws, ContactRule())).mean(1)
    standing = max(float(np.percentile(height, 90)), 1e-6)
    highest = MOST_STRETCHED * reach / standing
    if rule == "height":
        return highest
    limbs = [limb_length(mocap, limb) for limb in mapping.limbs(mocap)]
    return min(reach / float(np.mean(limbs)), highest)


def limb_length(mocap: Mocap, limb: Sequence[str]) -> float:
    """Sum of the bones between the nodes of a limb, median over the clip, m."""
    bones = np.linalg.norm(np.diff(mocap.keypoints(limb), axis=1), axis=-1)
    return float(np.median(bones, axis=0).sum())


def paw_contacts(mocap: Mocap, mapping: BodyMap) -> np.ndarray:
    """Which paws stand (T, F)."""
    paws, hips = mocap.keypoints(mapping.limb_ends(mocap)), mocap.keypoints(mapping.hips)
    return detect_contacts(paws, hips.mean(1), mocap.fps, ContactRule())


def _heading(quat: np.ndarray, fps: float) -> np.ndarray:
    """Turns about z (T, 4) of a trunk whose course is smoothed over time."""
    forward = rotations.rotate(quat, np.array([1.0, 0.0, 0.0]))[:, :2]
    forward = smooth(forward, HEADING_SIGMA * fps)
    return rotations.from_yaw(np.arctan2(forward[:, 1], forward[:, 0]))
