"""What is computed and checked on equally spaced series of states, frame by frame."""

from __future__ import annotations

import numpy as np

from lacoloco.datasets import rotations

SERIES = ("root_pos", "root_quat", "root_lin_vel_b", "root_ang_vel_b", "joint_pos", "joint_vel")
"""The fields of a clip that hold one row per frame."""
VELOCITIES = ("root_lin_vel_b", "root_ang_vel_b", "joint_vel")
"""Those of them that are per second."""
OPTIONAL = ("contacts", "joint_target", "command", "gait_memory")
"""Those that do, of clips about which this is known."""

_WIDTHS = dict.fromkeys(("root_pos", "root_lin_vel_b", "root_ang_vel_b", "command"), 3) | {
    "root_quat": 4,
    "gait_memory": 3,
}
_UNIT_TOLERANCE = 1e-3
"""What single precision, and a file with few digits, may be off by."""


def angular_velocities_b(quat: np.ndarray, fps: float) -> np.ndarray:
    """Angular velocity (T, 3) in the base frame, rad/s, of T >= 2 unit quaternions wxyz (T, 4).

    At each frame it is the mean over the intervals before and after it.
    Each interval has their constant angular velocity in the base frame, so the mean is a
    central difference that still takes the shortest arc between neighbours.
    """
    between = rotations.angular_velocity_b(quat[:-1], quat[1:], 1 / fps)
    result = np.concatenate([between[:1], between])
    result[1:-1] = 0.5 * (between[:-1] + between[1:])
    return result


def resampled(series: dict[str, np.ndarray], fps: float, new_fps: float) -> dict[str, np.ndarray]:
    """Series (T, ...) at another rate, from time 0 to the last new frame within the old ones.

    "root_quat" is blended by slerp, bool series take the nearest frame, all others blend linearly.
    """
    last = len(series["root_quat"]) - 1
    count = int(np.floor(last / fps * new_fps + 1e-6)) + 1
    position = np.minimum(np.arange(count) * (fps / new_fps), last)
    low = np.minimum(position.astype(int), max(last - 1, 0))
    high = np.minimum(low + 1, last)
    result = {}
    for name, values in series.items():
        share = (position - low).astype(values.dtype)
        if values.dtype == bool:
            result[name] = values[np.round(position).astype(int)]
        elif name == "root_quat":
            result[name] = rotations.continuous(rotations.slerp(values[low], values[high], share))
        else:
            result[name] = values[low] + share[:, None] * (values[high] - values[low])
    return result


def width(name: str, joints: int) -> int:
    """Numbers per frame of a series, for a robot with so many joints; contacts have any."""
    return _WIDTHS.get(name, joints)


def are_unit(quat: np.ndarray) -> bool:
    """Whether quaternions (T, 4) are of unit length, to a thousandth."""
    return bool((_off_unit(quat) <= _UNIT_TOLERANCE).all())


def _off_unit(quat: np.ndarray) -> np.ndarray:
    return np.abs(np.sqrt((quat**2).sum(1)) - 1)


def problem(rows: dict[str, np.ndarray], joints: int) -> str:
    """The first thing that is wrong with the series of a clip, in words; "" when nothing is.

    Args:
        rows: the series by name, those of ``OPTIONAL`` only if known.
        joints: how many joints they should be for.
    """
    frames = len(rows["root_pos"])
    if frames == 0:
        return "has no frames"
    for name in (name for name in rows if name != "contacts"):
        expected = (frames, width(name, joints))
        if rows[name].shape != expected:
            return f"{name} has shape {rows[name].shape}, expected {expected}"
        finite = np.isfinite(rows[name])
        if not finite.all():
            return f"{name} is not finite in frame {int(np.argmin(finite.all(1)))}"
    error = _off_unit(rows["root_quat"])
    if error.max() > _UNIT_TOLERANCE:
        return f"root_quat is not of unit length in frame {int(error.argmax())}"
    contacts = rows.get("contacts")
    if contacts is not None and (
        contacts.ndim != 2 or len(contacts) != frames or contacts.dtype != bool
    ):
        return f"contacts have shape {contacts.shape}, expected ({frames}, feet) of bool"
    return ""
