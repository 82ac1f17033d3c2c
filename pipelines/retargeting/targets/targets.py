"""Where the robot's keypoints should be: the animal's as they are (paper), or fitted to the robot.

Fitting keeps the motion and drops what is only anatomy. Sizes shrink by one factor, so that the
legs bend as the animal's do; the hips become the robot's (a dog's are half as far apart); each foot
keeps its place relative to its hip, but below the hip of the robot; and a paw that stands puts the
robot's foot sphere on the ground, however high its marker was. A foot with a heel and toes is
pitched and points as the person's. Arms point as the person's; how long they are is the robot's.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from lacoloco.datasets import rotations
from lacoloco.datasets.mocap import Mocap
from lacoloco.pipelines.retargeting.filters import smooth
from lacoloco.pipelines.retargeting.mocap.body_map import BodyMap, LegGeometry
from lacoloco.pipelines.retargeting.mocap.soles import recorded_feet, sagittal
from lacoloco.pipelines.retargeting.targets.contacts import (
    ContactRule,
    detect_contacts,
    stance_heights,
)
from lacoloco.pipelines.retargeting.targets.trunk import follow_arms, trunk_poses

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
    """(T, P) bool, what of the animal's feet stands, in the order of `RobotSpec.foot_points`."""
    scale: float
    """Size of the robot's motion relative to the animal's."""


def plain_targets(mocap: Mocap, mapping: BodyMap) -> Targets:
    """The recorded keypoints unchanged, as in the paper.

    Args:
        mocap: Motion.
        mapping: Its joints in the order of the robot's keypoints.

    Raises:
        DatasetError: The skeleton lacks one of them.
    """
    return Targets(mapping.keypoints(mocap), paw_contacts(mocap, mapping), 1.0)


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
    hips, paws = mocap.keypoints(mapping.hips), mapping.foot_points(mocap)
    ground = stance_heights(paws, ContactRule())
    if scale is None:
        scale = natural_scale(mocap, mapping, legs, foot_radius, rule)
    recorded = mocap.keypoints(mapping.joints)
    center, quat = trunk_poses(scale * recorded, mapping, legs)
    onto_ground = np.array([0.0, 0.0, foot_radius - scale * ground.mean()])
    trunk = center[:, None] + rotations.rotate(quat[:, None], legs.hips[None])

    heading = _heading(quat, mocap.fps)
    flat_hips = scale * hips - center[:, None]
    own = np.median(rotations.rotate_inverse(heading[:, None], flat_hips), axis=0)
    offset = rotations.rotate(heading[:, None], (legs.feet - own)[None])
    if mapping.soles:
        feet = robot_feet(mocap, mapping, ground, foot_radius, scale, offset)
    else:
        feet = scale * paws + offset
        feet[..., 2] = scale * np.maximum(paws[..., 2] - ground, 0.0) + foot_radius

    points = np.empty((mocap.frames, len(mapping.joints), 3))
    points[:, mapping.hip_keypoints] = trunk + onto_ground
    points[:, mapping.foot_keypoints] = feet
    follow_arms(points, recorded, center + onto_ground, quat, mapping, legs)
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
    paws, hips = mapping.foot_points(mocap), mocap.keypoints(mapping.hips)[:, mapping.legs]
    height = (hips[..., 2] - stance_heights(paws, ContactRule())).mean(1)
    standing = max(float(np.percentile(height, 90)), 1e-6)
    highest = MOST_STRETCHED * reach / standing
    if rule == "height":
        return highest
    return min(reach / mapping.limb_length(mocap), highest)


def robot_feet(
    mocap: Mocap,
    mapping: BodyMap,
    ground: np.ndarray,
    foot_radius: float,
    scale: float,
    offset: np.ndarray,
) -> np.ndarray:
    """(T, P, 3) heels and toes of the robot that are pitched and point as the person's do, m.

    Args:
        mocap: Motion.
        mapping: Feet of person and robot.
        ground: (P,) heights at which the person's heels and toes stand, m.
        foot_radius: m.
        scale: Size of the robot's motion relative to the person's.
        offset: (T, F, 3) m, from the scaled ankles to those of the robot.
    """
    nodes = mocap.keypoints(mapping.limb_ends(mocap))
    own = recorded_feet(nodes, mocap.keypoints(mapping.hips), mapping.soles)
    length, behind, height = np.array(
        [(sole.length, sole.behind, sole.height) for sole in mapping.soles]
    ).T
    heels = sagittal(own.forward, own.pitch, -behind, -height)
    toes = sagittal(own.forward, own.pitch, length - behind, -height)
    ankles = scale * own.ankles + offset
    air = np.minimum(own.heels[..., 2] - ground[::2], own.toes[..., 2] - ground[1::2])
    lowest = np.minimum(heels[..., 2], toes[..., 2])
    ankles[..., 2] = foot_radius + scale * np.maximum(air, 0.0) - lowest
    feet = np.stack([ankles + heels, ankles + toes], axis=2)
    return feet.reshape(mocap.frames, -1, 3)


def paw_contacts(mocap: Mocap, mapping: BodyMap) -> np.ndarray:
    """Which points of feet stand (T, P)."""
    paws, hips = mapping.foot_points(mocap), mocap.keypoints(mapping.hips)
    return detect_contacts(paws, hips.mean(1), mocap.fps, ContactRule())


def _heading(quat: np.ndarray, fps: float) -> np.ndarray:
    """Turns about z (T, 4) of a trunk whose course is smoothed over time."""
    forward = rotations.rotate(quat, np.array([1.0, 0.0, 0.0]))[:, :2]
    forward = smooth(forward, HEADING_SIGMA * fps)
    return rotations.from_yaw(np.arctan2(forward[:, 1], forward[:, 0]))
