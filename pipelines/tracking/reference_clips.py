"""What a tracker follows: the clips, at several paces, and after them the robot standing still."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from lacoloco.datasets.clip import Clip
from lacoloco.pipelines.sim.physics import CONTROL_DT
from lacoloco.robots.geometry import standing_height
from lacoloco.robots.spec import RobotSpec

STILL_S = 3.0
"""How long the robot stands in the last clip [s]."""


def repertoire(spec: RobotSpec, clips: Sequence[Clip], paces: Sequence[float]) -> list[Clip]:
    """Every clip at every pace (1 is its own), then :func:`standing`.

    An animal larger than the robot hardly ever walks as slowly as a robot has to before a target.

    Raises:
        DatasetError: a pace is not positive.
    """
    paced = [_named(clip, pace) for pace in paces for clip in clips]
    return [*paced, standing(spec)]


def standing(spec: RobotSpec) -> Clip:
    """The robot in its default pose, feet on the ground."""
    frames, pose = (
        round(STILL_S / CONTROL_DT) + 1,
        np.array(spec.default_joint_pos, dtype=np.float64),
    )
    height = standing_height(spec.model(), pose, spec.feet)
    return Clip.from_poses(
        "standing",
        1.0 / CONTROL_DT,
        spec.joint_names,
        np.tile([0.0, 0.0, height], (frames, 1)),
        np.tile([1.0, 0.0, 0.0, 0.0], (frames, 1)),
        np.tile(pose, (frames, 1)),
    )


def _named(clip: Clip, pace: float) -> Clip:
    return clip if pace == 1.0 else replace(clip.at_pace(pace), name=f"{clip.name}_pace{pace:g}")
