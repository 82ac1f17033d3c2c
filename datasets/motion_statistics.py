"""What is in a library of motions: clips, seconds, speeds, turning and heights."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from lacoloco.datasets import rotations
from lacoloco.datasets.clip import Clip

MEANS = ("speed_mean_m_s", "forward_mean_m_s", "turning_mean_rad_s", "height_mean_m")
"""Statistics of a clip of which a group has the mean over its seconds."""


def clip_statistics(clip: Clip) -> dict[str, Any]:
    """What a clip does, in numbers.

    Returns:
        `name`, `skill`, `seconds`, `fps`, `weight`; `speed_mean_m_s` and `speed_max_m_s` over the
        ground; `forward_mean_m_s` along the base's x axis; `turning_mean_rad_s` about world z,
        positive to the left; `turned_rad`, the same over the whole clip; `distance_m` between the
        first and the last frame, over the ground; the base's `height_min_m`, `height_mean_m`,
        `height_max_m`; `joint_speed_max_rad_s`; `stance_share` of feet that touch the ground, None
        where that is not known.
    """
    velocity = rotations.rotate(clip.root_quat, clip.root_lin_vel_b)
    speed = np.linalg.norm(velocity[:, :2], axis=1)
    turning = rotations.rotate(clip.root_quat, clip.root_ang_vel_b)[:, 2]
    height = clip.root_pos[:, 2]
    contacts = clip.contacts
    return {
        "name": clip.name,
        "skill": clip.skill,
        "seconds": clip.duration,
        "fps": clip.fps,
        "weight": clip.weight,
        "speed_mean_m_s": float(speed.mean()),
        "speed_max_m_s": float(speed.max()),
        "forward_mean_m_s": float(clip.root_lin_vel_b[:, 0].mean()),
        "turning_mean_rad_s": float(turning.mean()),
        "turned_rad": float(turning.mean() * clip.duration),
        "distance_m": float(np.linalg.norm(clip.root_pos[-1, :2] - clip.root_pos[0, :2])),
        "height_min_m": float(height.min()),
        "height_mean_m": float(height.mean()),
        "height_max_m": float(height.max()),
        "joint_speed_max_rad_s": float(np.abs(clip.joint_vel).max(initial=0.0)),
        "stance_share": None if contacts is None or not contacts.size else float(contacts.mean()),
    }


def group_statistics(clips: Sequence[dict[str, Any]], skill: str) -> dict[str, Any]:
    """What a group of clips does together.

    Args:
        clips: At least one, from :func:`clip_statistics`.
        skill: Name of the group.

    Returns:
        `skill`, `clips`, `seconds`; means over all seconds of ``MEANS``; the largest
        `speed_max_m_s`; the range of the mean turning of its clips, `turning_min_rad_s` and
        `turning_max_rad_s`; `height_min_m` and `height_max_m`.
    """
    # A clip of one frame lasts no time and counts like a short one.
    seconds = np.array([clip["seconds"] for clip in clips])
    weights = np.maximum(seconds, 1e-6)
    means = {
        name: float(np.average([clip[name] for clip in clips], weights=weights)) for name in MEANS
    }
    turning = [clip["turning_mean_rad_s"] for clip in clips]
    return {
        "skill": skill,
        "clips": len(clips),
        "seconds": float(seconds.sum()),
        **means,
        "speed_max_m_s": max(clip["speed_max_m_s"] for clip in clips),
        "turning_min_rad_s": min(turning),
        "turning_max_rad_s": max(turning),
        "height_min_m": min(clip["height_min_m"] for clip in clips),
        "height_max_m": max(clip["height_max_m"] for clip in clips),
    }


def library_statistics(clips: Sequence[Clip]) -> dict[str, Any]:
    """Statistics of all clips: `clips`, one entry each; `skills`, one each; `total`."""
    each = [clip_statistics(clip) for clip in clips]
    skills: dict[str, list[dict[str, Any]]] = {}
    for one in each:
        skills.setdefault(one["skill"], []).append(one)
    return {
        "clips": each,
        "skills": [group_statistics(members, skill) for skill, members in skills.items()],
        "total": group_statistics(each, "all"),
    }
