"""The robot's trunk in place of the recorded one, and the arms on it."""

from __future__ import annotations

import numpy as np

from lacoloco.datasets import rotations
from lacoloco.pipelines.retargeting.alignment import rigid_fit
from lacoloco.pipelines.retargeting.mocap.body_map import BodyMap, LegGeometry


def trunk_poses(
    points: np.ndarray, mapping: BodyMap, legs: LegGeometry
) -> tuple[np.ndarray, np.ndarray]:
    """Poses of the base that put the robot's hips on the recorded ones, on average.

    Hips of four legs tell how the trunk lies. Two do not: there up is from the hips to where the
    arms begin, and left is across the hips. The robot stands upright where the person does.

    Args:
        points: (T, K, 3) recorded joints at the robot's size, m.
        mapping: Which of them are hips and where arms begin.
        legs: The robot's.

    Returns:
        Positions (T, 3) and quaternions (T, 4), wxyz.
    """
    hips = points[:, mapping.hip_keypoints]
    if not mapping.arms:
        return rigid_fit(legs.hips, hips)
    shoulders = points[:, [arm[0] for arm in mapping.arms]]
    up = _unit(shoulders.mean(1) - hips.mean(1))
    left = _across(hips, legs.hips)
    left = _unit(left - (left * up).sum(1, keepdims=True) * up)
    axes = np.stack([np.cross(left, up), left, up], axis=-1)
    quat = rotations.continuous(rotations.from_matrix(axes))
    return hips.mean(1) - rotations.rotate(quat, legs.hips.mean(0)), quat


def follow_arms(
    points: np.ndarray,
    recorded: np.ndarray,
    center: np.ndarray,
    quat: np.ndarray,
    mapping: BodyMap,
    legs: LegGeometry,
) -> None:
    """Put the arms' targets into (T, K, 3) points, m.

    Arms begin on the trunk, turned about its length as far as the recorded shoulders are against
    the hips; each bone points as the recorded one.

    Args:
        points: The targets.
        recorded: (T, K, 3) recorded joints.
        center: (T, 3) of the base, m.
        quat: (T, 4) of the base, wxyz.
        mapping: Which keypoints are arms.
        legs: The robot's keypoints.
    """
    roots = [arm[0] for arm in mapping.arms]
    if not roots:
        return
    turned = rotations.multiply(
        quat, rotations.from_yaw(_twist(recorded[:, roots], quat, legs.points[roots]))
    )
    for arm in mapping.arms:
        points[:, arm[0]] = center + rotations.rotate(turned, legs.points[arm[0]])
        for before, after in zip(arm[:-1], arm[1:], strict=True):
            length = np.linalg.norm(legs.points[after] - legs.points[before])
            bone = _unit(recorded[:, after] - recorded[:, before])
            points[:, after] = points[:, before] + length * bone


def _twist(roots: np.ndarray, quat: np.ndarray, own: np.ndarray) -> np.ndarray:
    """Angle (T,) about the trunk's length by which shoulders are turned to the left, rad."""
    if not (own[:, 1] > 0).any() or not (own[:, 1] < 0).any():
        return np.zeros(len(roots))
    across = rotations.rotate_inverse(quat, _across(roots, own))
    return np.arctan2(-across[:, 0], across[:, 1])


def _across(points: np.ndarray, own: np.ndarray) -> np.ndarray:
    """Vectors (T, 3) from the right points to the left ones, by the robot's own (N, 3)."""
    left, right = own[:, 1] > 0, own[:, 1] < 0
    return points[:, left].mean(1) - points[:, right].mean(1)


def _unit(vectors: np.ndarray) -> np.ndarray:
    return vectors / np.maximum(np.linalg.norm(vectors, axis=-1, keepdims=True), 1e-9)
