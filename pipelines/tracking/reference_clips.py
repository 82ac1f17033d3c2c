"""The clips that a tracker follows: all clips at several speeds, and the robot standing still."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from lacoloco.datasets.clip import Clip
from lacoloco.pipelines.sim.physics import CONTROL_DT
from lacoloco.robots.geometry import standing_height
from lacoloco.robots.spec import RobotSpec

STANDING_S = 3.0
"""Length of the last clip, in which the robot stands still [s]."""


def reference_clips(
    spec: RobotSpec, clips: Sequence[Clip], speed_factors: Sequence[float]
) -> list[Clip]:
    """Every clip at every speed factor (1: as it is), then :func:`standing_clip`.

    An animal larger than the robot hardly ever walks as slowly as a robot has to before a target.

    Raises:
        DatasetError: A speed factor is not positive.
    """
    scaled = [_at_speed(clip, factor) for factor in speed_factors for clip in clips]
    return [*scaled, standing_clip(spec)]


def standing_clip(spec: RobotSpec) -> Clip:
    """The robot in its default pose, feet on the ground."""
    frames = round(STANDING_S / CONTROL_DT) + 1
    pose = np.array(spec.default_joint_pos, dtype=np.float64)
    height = standing_height(spec.model(), pose, spec.feet)
    return Clip.from_poses(
        "standing",
        1.0 / CONTROL_DT,
        spec.joint_names,
        np.tile([0.0, 0.0, height], (frames, 1)),
        np.tile([1.0, 0.0, 0.0, 0.0], (frames, 1)),
        np.tile(pose, (frames, 1)),
    )


def _at_speed(clip: Clip, factor: float) -> Clip:
    if factor == 1.0:
        return clip
    return replace(clip.at_pace(factor), name=f"{clip.name}_speed{factor:g}")
