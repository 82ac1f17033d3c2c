"""The base of a foreign motion in our convention: quaternions (w, x, y, z) of length 1."""

from __future__ import annotations

import numpy as np

from lacoloco.datasets import rotations
from lacoloco.datasets.errors import DatasetError
from lacoloco.datasets.foreign.motion import ForeignMotion

ORDERS = {"wxyz": (0, 1, 2, 3), "xyzw": (3, 0, 1, 2)}
"""Order of a file -> its columns of w, x, y, z."""
_UPRIGHT, _TILTED = 0.8, 1.0
"""Tilt of the base, rad, below and above which an order is right and wrong; the 90 % quantile over
the frames. With w in the wrong place, a base that turns about z seems to tilt by as much.
"""
_UNIT_TOLERANCE = 0.01


def root_quaternions(motion: ForeignMotion, asked: str | None) -> tuple[np.ndarray, str]:
    """Orientations (T, 4) wxyz of unit length, signs continuous, and the order they had.

    The order asked for is taken, else that of the format if the base is not upright in the other
    one only, else the only order in which it is.

    Raises:
        DatasetError: Not of unit length, or no order is right beyond doubt; the message names
            `--quaternion`.
    """
    length = np.linalg.norm(motion.root_quat, axis=1)
    wrong = np.abs(length - 1.0) > _UNIT_TOLERANCE
    if wrong.any():
        frame = int(np.argmax(wrong))
        raise DatasetError(
            f"{motion.name}: the orientation of frame {frame} has length {length[frame]:.3g}, so"
            " its four columns are no quaternion"
        )
    order = asked or _order(motion)
    quat = rotations.normalize(motion.root_quat)[:, ORDERS[order]]
    return rotations.continuous(quat), order


def _order(motion: ForeignMotion) -> str:
    tilts = {name: _tilts(motion.root_quat[:, columns]) for name, columns in ORDERS.items()}
    usual = {name: float(np.quantile(tilt, 0.9)) for name, tilt in tilts.items()}
    upright = [name for name, tilt in usual.items() if tilt < _UPRIGHT]
    tilted = [name for name, tilt in usual.items() if tilt > _TILTED]
    decided = len(upright) == len(tilted) == 1
    told = ", ".join(f"{np.degrees(tilt):.0f} deg as {name}" for name, tilt in usual.items())
    order = motion.quat_order
    if order is not None and not (decided and order in tilted):
        if np.quantile(tilts[order], 0.1) > _TILTED:
            raise DatasetError(
                f"{motion.name}: its base is never upright (it tilts by {told}), so its frame is"
                f" another than the robot's; if it is right, say --quaternion {order}"
            )
        return order
    if order is not None:
        raise DatasetError(
            f"{motion.name}: a {motion.kind} has its orientation as {order}, but the base is"
            f" upright as {upright[0]} only: say which with --quaternion"
        )
    if decided:
        return upright[0]
    raise DatasetError(
        f"{motion.name}: which column of its orientation is w cannot be told from it (the base"
        f" tilts by {told}): say --quaternion wxyz or xyzw"
    )


def _tilts(quat: np.ndarray) -> np.ndarray:
    """(T,) angle between the base's z axis and the world's, rad, of (T, 4) wxyz."""
    unit = rotations.normalize(quat)
    cosine = 1.0 - 2.0 * (unit[:, 1] ** 2 + unit[:, 2] ** 2)
    return np.arccos(np.clip(cosine, -1.0, 1.0))
