"""`.txt` / `.json` of motion_imitation and of AMP for hardware.

Sources: erwincoumans/motion_imitation `motion_imitation/utilities/motion_data.py` and
`motion_imitation/robots/a1.py` (commit d0e7b96): JSON with `LoopMode`, `FrameDuration` [s] and
`Frames`, each a position, a quaternion (x, y, z, w) and the joints, leg by leg: front right, front
left, rear right, rear left. AMP for hardware `rsl_rl/rsl_rl/datasets/motion_loader.py` (class
`AMPLoader` and its `reorder_from_pybullet_to_isaac`): the same, followed by toe positions, linear
and angular velocities, joint velocities and toe velocities of a robot with twelve joints, and
`MotionWeight`.
"""

from __future__ import annotations

import json
from pathlib import Path

from lacoloco.datasets.errors import DatasetError, storage_errors
from lacoloco.datasets.foreign.motion import ForeignMotion, numbers, rate

BASE = 7
AMP_JOINTS = 12
AMP_WIDTH = BASE + 4 * AMP_JOINTS + 6


def read_frames(path: Path) -> ForeignMotion:
    """The motion of a JSON file of frames.

    Raises:
        DatasetError: It is no JSON, or has no such frames.
    """
    try:
        with storage_errors(path, "read"):
            content = json.loads(path.read_text(encoding="utf-8"))
    except (ValueError, RecursionError) as error:
        raise DatasetError(f"{path}: is no JSON ({str(error)[:80]})") from error
    if not isinstance(content, dict) or not {"Frames", "FrameDuration"} <= content.keys():
        raise DatasetError(f"{path}: has no Frames with a FrameDuration")
    frames = numbers(content["Frames"], "Frames", str(path))
    duration = rate(content["FrameDuration"], str(path))
    if frames.ndim != 2 or frames.shape[1] <= BASE or not duration > 0:
        raise DatasetError(f"{path}: Frames has shape {frames.shape}, each of {duration:g} s")
    of_amp = frames.shape[1] == AMP_WIDTH
    joints = frames[:, BASE : BASE + AMP_JOINTS] if of_amp else frames[:, BASE:]
    return ForeignMotion(
        path.stem,
        "frames of AMP for hardware" if of_amp else "frames of motion_imitation",
        frames[:, :3],
        frames[:, 3:BASE],
        "xyzw",
        joints,
        None,
        "legs",
        1.0 / duration,
        rate(content.get("MotionWeight", 1.0), str(path)),
    )
