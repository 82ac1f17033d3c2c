"""CSV files: Unitree's retargeted LAFAN1, and tables with a header.

Sources: README of the data set "LAFAN1 Retargeting Dataset" (lvhaidong, unitreerobotics; "The Order
of Configuration"), and `scripts/csv_to_npz.py` of HybridRobotics/whole_body_tracking (commit
cd65172), which reads it: no header, 30 frames per second; position, quaternion (x, y, z, w), and
the joints below. A table with a header is found by the names of its columns, in any order.
"""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np

from lacoloco.datasets.errors import DatasetError, storage_errors
from lacoloco.datasets.foreign.motion import ForeignMotion, QuatOrder

BASE = 7
LAFAN_FPS = 30.0
_ARM = ("shoulder_pitch", "shoulder_roll", "shoulder_yaw", "elbow")
_WRIST = ("wrist_roll", "wrist_pitch", "wrist_yaw")


def _both(*parts: str) -> tuple[str, ...]:
    return tuple(f"{side}_{part}_joint" for side in ("left", "right") for part in parts)


LAFAN_JOINTS: dict[int, tuple[str, ...]] = {
    29: (
        *_both("hip_pitch", "hip_roll", "hip_yaw", "knee", "ankle_pitch", "ankle_roll"),
        *("waist_yaw_joint", "waist_roll_joint", "waist_pitch_joint"),
        *_both(*_ARM, *_WRIST),
    ),
    27: (
        *_both("hip_yaw", "hip_pitch", "hip_roll", "knee", "ankle_pitch", "ankle_roll"),
        "torso_joint",
        *_both(*_ARM, *_WRIST),
    ),
    19: (
        *_both("hip_yaw", "hip_roll", "hip_pitch", "knee", "ankle"),
        "torso_joint",
        *_both(*_ARM),
    ),
}
"""Number of joints -> their names: the G1, the H1_2 and the H1."""

POSITION = tuple(f"root_{axis}" for axis in "xyz")
QUAT = tuple(f"root_q{axis}" for axis in "wxyz")
_SAME = {
    **{
        f"{head}{axis}": f"root_{axis}"
        for axis in "xyz"
        for head in ("", "pos_", "root_pos_", "base_")
    },
    **{
        f"{head}{axis}": f"root_q{axis}"
        for axis in "wxyz"
        for head in ("q", "quat_", "root_quat_", "root_rot_", "base_q")
    },
    **dict.fromkeys(("t", "time_s", "timestamp"), "time"),
}
"""Other names of columns -> those that lacoloco writes."""
_NOT_JOINTS = ("time", "frame", "index")


def read_csv(path: Path) -> ForeignMotion:
    """The motion of a CSV file.

    Raises:
        DatasetError: It is no table of numbers, or its header lacks position or orientation.
    """
    header, rows = _read(path)
    if header is None:
        return _headless(path, rows)
    names = [_SAME.get(name.lower(), name) for name in header]
    if len(set(names)) < len(names):
        raise DatasetError(f"{path}: two columns say the same: {', '.join(header)[:200]}")
    missing = [name for name in (*POSITION, *QUAT) if name not in names]
    if missing:
        raise DatasetError(
            f"{path}: its header has no {', '.join(missing)}; name the columns"
            f" {', '.join((*POSITION, *QUAT))}, then the joints"
        )
    taken = {*POSITION, *QUAT, *_NOT_JOINTS}
    joints = [index for index, name in enumerate(names) if name not in taken]
    return ForeignMotion(
        path.stem,
        "CSV with a header",
        rows[:, [names.index(name) for name in POSITION]],
        rows[:, [names.index(name) for name in QUAT]],
        "wxyz",
        rows[:, joints],
        tuple(names[index] for index in joints),
        None,
        _rate(rows[:, names.index("time")], path) if "time" in names else None,
    )


def _headless(path: Path, rows: np.ndarray) -> ForeignMotion:
    joints = rows.shape[1] - BASE
    if joints < 1:
        raise DatasetError(
            f"{path}: {rows.shape[1]} columns are no position, orientation and joints"
        )
    names = LAFAN_JOINTS.get(joints)
    order: QuatOrder | None = "xyzw" if names else None
    return ForeignMotion(
        path.stem,
        "CSV of retargeted LAFAN1" if names else "CSV without a header",
        rows[:, :3],
        rows[:, 3:BASE],
        order,
        rows[:, BASE:],
        names,
        None,
        LAFAN_FPS if names else None,
    )


def _read(path: Path) -> tuple[list[str] | None, np.ndarray]:
    """The header, if there is one, and the numbers."""
    try:
        with storage_errors(path, "read"):
            text = path.read_text(encoding="utf-8-sig")
    except UnicodeDecodeError as error:
        raise DatasetError(f"{path}: is no text") from error
    try:
        lines = [[cell.strip() for cell in row] for row in csv.reader(text.splitlines()) if row]
    except csv.Error as error:  # a quotation mark that nothing closes
        raise DatasetError(f"{path}: is no CSV ({error})") from error
    header = lines.pop(0) if lines and not _is_number(lines[0][0]) else None
    width = len(header or (lines[0] if lines else ()))
    for number, line in enumerate(lines, 1 + (header is not None)):
        if len(line) != width:
            raise DatasetError(f"{path}: line {number} has {len(line)} values, not {width}")
    try:
        return header, np.array(lines, dtype=np.float64).reshape(len(lines), width)
    except ValueError as error:
        raise DatasetError(f"{path}: {str(error)[:80]}") from error


def _is_number(cell: str) -> bool:
    try:
        float(cell)
    except ValueError:
        return False
    return True


def _rate(time: np.ndarray, path: Path) -> float:
    """Frames per second of a column of seconds."""
    steps = np.diff(time)
    step = float(np.median(steps)) if len(steps) else 0.0
    if not step > 0 or not (np.abs(steps - step) < 0.1 * step).all():
        raise DatasetError(f"{path}: the times of its frames are not equally spaced")
    return 1.0 / float(np.mean(steps))
