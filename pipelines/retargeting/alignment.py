"""Rigid fits of one set of points to another (Kabsch)."""

from __future__ import annotations

import numpy as np

from lacoloco.datasets import rotations


def rigid_fit(points: np.ndarray, targets: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Pose that maps points onto targets with the least sum of squares, for T sets at once.

    Kabsch, "A solution for the best rotation to relate two sets of vectors", 1976; always a proper
    rotation.

    Args:
        points: (K, 3), the same for all sets.
        targets: (T, K, 3).

    Returns:
        Positions (T, 3) and quaternions (T, 4), wxyz: target ~ position + rotate(quat, point).
    """
    center, centers = points.mean(0), targets.mean(1)
    covariance = (points - center).T @ (targets - centers[:, None])  # (T, 3, 3)
    left, _, right = np.linalg.svd(covariance)
    mirrored = np.linalg.det(left @ right) < 0
    right[mirrored, 2] *= -1
    rotation = np.swapaxes(left @ right, 1, 2)
    return centers - rotation @ center, rotations.from_matrix(rotation)
