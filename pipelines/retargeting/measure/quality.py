"""How good a retargeted clip is, in numbers a person can judge."""

from __future__ import annotations

from typing import Any

import numpy as np

from lacoloco.pipelines.retargeting.filters import smooth

LIMIT_MARGIN = 1e-3
"""rad; a joint this close to a bound rests on it."""
LOW = 0.01
"""m; a foot this close to the ground should not slip."""
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
        both; `low_foot_slip_mean_m_s`, the same of feet that are low, whether the paw is said to
        stand or not; `stance_share`, share of the frames in which a paw stands;
        `ground_penetration_max_m`; `stance_float_max_m`, gap below a standing foot;
        `contact_agreement`, share of feet and frames that touch the ground as the paws do.
    """
    speed = np.linalg.norm(np.diff(feet[..., :2], axis=0), axis=-1) * fps
    standing = contacts[1:] & contacts[:-1]
    gap = feet[..., 2] - radius
    low = (gap[1:] < LOW) & (gap[:-1] < LOW)
    return {
        "stance_share": float(contacts.any(axis=1).mean()),
        "low_foot_slip_mean_m_s": float(speed[low].mean()) if low.any() else 0.0,
        "foot_skate_mean_m_s": float(speed[standing].mean()) if standing.any() else 0.0,
        # In whole nanometres: what is less is rounding.
        "ground_penetration_max_m": round(max(0.0, float(-gap.min())), 9),
        "stance_float_max_m": float(max(gap[contacts].max(), 0.0)) if contacts.any() else 0.0,
        "contact_agreement": float((touches(feet, radius) == contacts).mean()),
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


def course_quality(robot: np.ndarray, animal: np.ndarray, fps: float) -> dict[str, float]:
    """How high and how fast the robot goes, and the animal at the robot's size.

    Args:
        robot: (T, 3) m, the middle of its hips.
        animal: (T, 3) m, that of the animal's, as targets.
        fps: Frames per second.

    Returns:
        Means of both heights, m, and of both horizontal speeds, m/s, and of their differences from
        frame to frame, `height_error_mean_m` and `speed_error_mean_m_s`.
    """
    fast, faster = horizontal_speed(robot, fps), horizontal_speed(animal, fps)
    return {
        "base_height_mean_m": float(robot[:, 2].mean()),
        "animal_height_mean_m": float(animal[:, 2].mean()),
        "height_error_mean_m": float(np.abs(robot[:, 2] - animal[:, 2]).mean()),
        "base_speed_mean_m_s": float(fast.mean()),
        "animal_speed_mean_m_s": float(faster.mean()),
        "speed_error_mean_m_s": float(np.abs(fast - faster).mean()),
    }


def effort_quality(torque_share: np.ndarray, missing_share: np.ndarray) -> dict[str, float]:
    """Whether motors could drive the motion, and whether the ground could carry it.

    Args:
        torque_share: (T, J) torques of inverse dynamics over the motors' limits.
        missing_share: (T,) force that standing feet cannot give, over the robot's weight.

    Returns:
        `torque_share_peak` and `torque_share_p95`; `torque_limit_hits`, how many of all frames and
        joints are at or beyond the limit; `missing_force_mean` and `missing_force_p95`.
    """
    return {
        "torque_share_p95": float(np.percentile(torque_share, 95)),
        "torque_share_peak": float(torque_share.max()),
        "torque_limit_hits": int((torque_share >= 1.0).sum()),
        "missing_force_mean": float(missing_share.mean()),
        "missing_force_p95": float(np.percentile(missing_share, 95)),
    }


def horizontal_speed(course: np.ndarray, fps: float) -> np.ndarray:
    """Speed (T,) along the ground of a point (T, 3), m/s, without what shakes faster than 0.05
    s.
    """
    if len(course) < 2:
        return np.zeros(len(course))
    velocity = smooth(np.gradient(course[:, :2], 1 / fps, axis=0), 0.05 * fps)
    return np.linalg.norm(velocity, axis=-1)


def touches(feet: np.ndarray, radius: float) -> np.ndarray:
    """Which feet (T, F) touch the ground; centres of their spheres (T, F, 3), m."""
    return feet[..., 2] - radius < TOUCHING


def _peak(series: np.ndarray) -> float:
    return float(np.abs(series).max()) if series.size else 0.0
