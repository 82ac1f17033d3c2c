"""One foreign file -> one clip of the robot."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from lacoloco.datasets.clip import Clip
from lacoloco.datasets.errors import DatasetError
from lacoloco.datasets.foreign.reading import read_motion
from lacoloco.pipelines.foreign_motions.base import root_quaternions
from lacoloco.pipelines.foreign_motions.config import ImportConfig
from lacoloco.pipelines.foreign_motions.ground import foot_contacts, ground_height
from lacoloco.pipelines.foreign_motions.joints import check_ranges, joint_columns
from lacoloco.pipelines.sim.body_states import body_states
from lacoloco.robots.spec import RobotSpec

_LEVEL = 0.005
"""Metres that the ground may be off; less is not worth a change, nor a word."""
_MOST_FRAMES = 5_000_000
"""Of a clip: more than a day at the rate of the policies."""


@dataclass(frozen=True)
class Converted:
    """A clip, and what was found on the way."""

    file: Path
    clip: Clip
    metrics: dict[str, Any]
    remarks: tuple[str, ...]
    """What a person should know, one line each."""


def convert(spec: RobotSpec, file: Path, config: ImportConfig, name: str) -> Converted:
    """Read a file, and bring its motion into our joints, orientation, rate and height.

    Raises:
        DatasetError: The file cannot be used.
        StageError: Its joints are not those of the robot.
    """
    motion = read_motion(file)
    fps = config.source_fps or motion.fps
    if fps is None:
        raise DatasetError(f"{file}: does not say its frames per second: say --source-fps")
    if len(motion.root_pos) / fps * config.fps > _MOST_FRAMES:
        raise DatasetError(f"{file}: at {fps:g} frames per second it lasts days: say --source-fps")
    columns, left_out = joint_columns(spec, motion, config.joints or None)
    joints = np.unwrap(motion.joint_pos[:, columns], axis=0)
    remarks = check_ranges(spec, joints, name, asked=bool(config.joints))
    quat, order = root_quaternions(motion, config.quaternion or None)
    ground = ground_height(spec, body_states(spec, motion.root_pos, quat, joints))
    moved = abs(ground) > _LEVEL
    lift = -ground if moved and not config.keep_height else 0.0
    if moved:
        done = "left there" if config.keep_height else "moved to 0"
        remarks.append(f"{name}: its feet stand at height {ground:.3f} m; {done}")
    clip = Clip.from_poses(
        name,
        fps,
        spec.joint_names,
        motion.root_pos + np.array([0.0, 0.0, lift]),
        quat,
        joints,
        skill=config.skill,
        weight=motion.weight,
        source=file.name,
        licence=config.licence,
    ).resample(config.fps)
    bodies = body_states(spec, clip.root_pos, clip.root_quat, clip.joint_pos)
    clip = replace(clip, contacts=foot_contacts(spec, bodies, clip.fps))
    if left_out:
        remarks.append(f"{name}: {spec.name} has no {', '.join(left_out)}; left out")
    metrics = {
        "name": name,
        "kind": motion.kind,
        "frames": clip.frames,
        "seconds": clip.duration,
        "source_fps": fps,
        "quaternion": order,
        "lifted_m": lift,
        "stance_share": float(clip.contacts.mean()) if clip.contacts is not None else None,
        "left_out": left_out,
    }
    return Converted(file, clip, metrics, tuple(remarks))
