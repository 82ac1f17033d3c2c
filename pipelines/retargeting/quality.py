"""How good a retargeted clip is, in numbers a person can judge."""

from __future__ import annotations

from typing import Any

import numpy as np

LIMIT_MARGIN = 1e-3
"""rad; a joint this close to a bound rests on it."""


def keypoint_errors(points: np.ndarray, targets: np.ndarray) -> dict[str, float]:
    """Distances between the robot's keypoints and their targets.

    Args:
        points: (T, K, 3) m.
        targets: (T, K, 3) m.
    """
    distance = np.linalg.norm(points - targets, axis=-1)
    return {
        "keypoint_error_mean_m": float(distance.mean()),
        "keypoint_error_max_m": float(distance.max()),
    }


def foot_quality(
    feet: np.ndarray, contacts: np.ndarray, radius: float, fps: float
) -> dict[str, float]:
    """What the feet do that feet do not: slide while they stand, sink, float.

    Args:
        feet: (T, F, 3) centres of the foot spheres, m.
        contacts: (T, F) bool, which paws of the animal stand.
        radius: Of the spheres, m.
        fps: Frames per second.

    Returns:
        `foot_skate_mean_m_s`, horizontal speed from one frame to the next while the paw stands in
        both; `ground_penetration_max_m`; `stance_float_max_m`, gap below a standing foot.
    """
    speed = np.linalg.norm(np.diff(feet[..., :2], axis=0), axis=-1) * fps
    standing = contacts[1:] & contacts[:-1]
    gap = feet[..., 2] - radius
    return {
        "foot_skate_mean_m_s": float(speed[standing].mean()) if standing.any() else 0.0,
        "ground_penetration_max_m": round(float(max(-gap.min(), 0.0)), 9),  # nm: rounding errors
        "stance_float_max_m": float(max(gap[contacts].max(), 0.0)) if contacts.any() else 0.0,
    }


def limit_hits(joint_pos: np.ndarray, bounds: tuple[np.ndarray, np.ndarray]) -> dict[str, Any]:
    """Number of joint positions (over frames and joints) that rest on a bound, or are beyond it."""
    lower, upper = bounds
    at_bound = (joint_pos < lower + LIMIT_MARGIN) | (joint_pos > upper - LIMIT_MARGIN)
    return {"joint_limit_hits": int(at_bound.sum())}
