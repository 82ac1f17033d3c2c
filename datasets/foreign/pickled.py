"""Pickled motions of GMR and of MimicKit.

Sources: GMR `general_motion_retargeting/data_loader.py` and `scripts/bvh_to_robot.py` (commit
4f9e8b7): a dict with `fps`, `root_pos`, `root_rot` (x, y, z, w) and `dof_pos`, which is
`qpos[7:]` of the robot's MJCF. MimicKit `mimickit/anim/motion.py` and `motion_lib.py` (f8d0d70): a
dict with `loop_mode`, `fps` and `frames`, each frame a position, a rotation vector and the joints
in the order of the character's file.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

from lacoloco.datasets import rotations
from lacoloco.datasets.errors import DatasetError
from lacoloco.datasets.foreign.motion import ForeignMotion, numbers, rate
from lacoloco.datasets.foreign.pickles import read_pickle

_GMR = ("fps", "root_pos", "root_rot", "dof_pos")
_MIMICKIT = ("fps", "frames")


def read_pickled(path: Path) -> ForeignMotion:
    """The motion of a pickle, without executing it.

    Raises:
        DatasetError: See `read_pickle`; or it is neither of the two kinds.
    """
    content = read_pickle(path)
    if isinstance(content, dict) and all(key in content for key in _GMR):
        return _gmr(content, path)
    if isinstance(content, dict) and all(key in content for key in _MIMICKIT):
        return _mimickit(content, path)
    keys = ", ".join(map(str, content)) if isinstance(content, dict) else "no table"
    raise DatasetError(
        f"{path}: holds {' '.join(keys.split())[:80]}; a pickle of GMR has {', '.join(_GMR)},"
        f" one of MimicKit {', '.join(_MIMICKIT)}"
    )


def _gmr(content: dict[str, Any], path: Path) -> ForeignMotion:
    names = content.get("joint_names")
    return ForeignMotion(
        path.stem,
        "GMR pickle",
        numbers(content["root_pos"], "root_pos", str(path)),
        numbers(content["root_rot"], "root_rot", str(path)),
        "xyzw",
        numbers(content["dof_pos"], "dof_pos", str(path)),
        tuple(map(str, names)) if isinstance(names, list) else None,
        "model",
        rate(content["fps"], str(path)),
    )


def _mimickit(content: dict[str, Any], path: Path) -> ForeignMotion:
    frames = numbers(content["frames"], "frames", str(path))
    if frames.ndim != 2 or frames.shape[1] < 7:
        raise DatasetError(f"{path}: frames has shape {frames.shape}, not (T, 6 + joints)")
    return ForeignMotion(
        path.stem,
        "MimicKit pickle",
        frames[:, :3],
        rotations.exp_map(frames[:, 3:6]),
        "wxyz",
        frames[:, 6:],
        None,
        "model",
        rate(content["fps"], str(path)),
    )
