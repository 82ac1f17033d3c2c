"""How good a retargeted clip is, in numbers a person can judge."""

from __future__ import annotations

from typing import Any

import numpy as np

from lacoloco.pipelines.retargeting.targets import Targets

LIMIT_MARGIN = 1e-3
"""rad; a joint this close to a bound rests on it."""
TOUCHING = 3e-3
"""m; a foot this close to the ground touches it."""


def keypoint_errors(points: np.ndarray, targets: np.ndarray) -> dict[str, float]:
    """Distances between the robot's keypoints and their targets.

    Args:
        points: (T, K, 3) m.
        targets: (T, K, 3) m.
    """
    distance = np.linalg.norm(points - targets, axis=-1)
    return {
        "keypoint_error_mean_m": float(distance.mean()),
        "keypoint_error_p95_m": float(np.percentile(distance, 95)),
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
        both; `ground_penetration_max_m`; `stance_float_max_m`, gap below a standing foot;
        `contact_agreement`, share of feet and frames that touch the ground as the paws do.
    """
    speed = np.linalg.norm(np.diff(feet[..., :2], axis=0), axis=-1) * fps
    standing = contacts[1:] & contacts[:-1]
    gap = feet[..., 2] - radius
    return {
        "foot_skate_mean_m_s": float(speed[standing].mean()) if standing.any() else 0.0,
        # In whole nanometres: what is less is rounding.
        "ground_penetration_max_m": round(float(max(-gap.min(), 0.0)), 9),
        "stance_float_max_m": float(max(gap[contacts].max(), 0.0)) if contacts.any() else 0.0,
        "contact_agreement": float(((gap < TOUCHING) == contacts).mean()),
    }


def joint_quality(
    joint_pos: np.ndarray,
    bounds: tuple[np.ndarray, np.ndarray],
    speed_limits: np.ndarray,
    fps: float,
) -> dict[str, Any]:
    """How hard the joints are driven.

    Args:
        joint_pos: (T, J) rad.
        bounds: (J,) each, rad.
        speed_limits: (J,) rad/s.
        fps: Frames per second.

    Returns:
        `joint_limit_hits` and `joint_speed_hits`, numbers of positions and of steps (over frames
        and joints) at or beyond a limit; peaks of speed, rad/s, acceleration and jerk.
    """
    lower, upper = bounds
    at_bound = (joint_pos < lower + LIMIT_MARGIN) | (joint_pos > upper - LIMIT_MARGIN)
    speed = np.abs(np.diff(joint_pos, axis=0)) * fps
    return {
        "joint_limit_hits": int(at_bound.sum()),
        "joint_speed_hits": int((speed >= speed_limits).sum()),
        "joint_speed_peak": _peak(speed),
        "joint_acceleration_peak": _peak(np.diff(joint_pos, 2, axis=0) * fps**2),
        "joint_jerk_peak": _peak(np.diff(joint_pos, 3, axis=0) * fps**3),
    }


def clip_quality(
    points: np.ndarray, feet: np.ndarray, targets: Targets, radius: float, fps: float
) -> dict[str, Any]:
    """Errors of the keypoints as solved, and quality of the feet as they stand in the clip."""
    return {
        "scale": targets.scale,
        **keypoint_errors(points, targets.points),
        **foot_quality(feet, targets.contacts, radius, fps),
    }


def _peak(series: np.ndarray) -> float:
    return float(np.abs(series).max()) if series.size else 0.0
