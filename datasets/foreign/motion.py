"""A motion of another program, as its file has it: nothing is reordered or resampled yet."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from lacoloco.datasets.errors import DatasetError

QuatOrder = Literal["wxyz", "xyzw"]
MOST_NUMBERS = 200_000_000
"""In one array of a file; more are a damaged or hostile file, not a motion."""


@dataclass(frozen=True)
class ForeignMotion:
    """Poses of a robot in T frames, in the columns of the file."""

    name: str
    kind: str
    """What the file is, for messages: "GMR pickle"..."""
    root_pos: np.ndarray
    """(T, 3) m, world frame with z up."""
    root_quat: np.ndarray
    """(T, 4) base to world."""
    quat_order: QuatOrder | None
    """None where the format does not say."""
    joint_pos: np.ndarray
    """(T, J) rad."""
    joint_names: tuple[str, ...] | None
    """Of the columns; None where the file does not say."""
    joint_order: str | None
    """Where it does not: what its programs write, a value of `--joints`; None if they differ."""
    fps: float | None
    """None where the file does not say."""
    weight: float = 1.0

    def __post_init__(self) -> None:
        """Check shapes and numbers.

        Raises:
            DatasetError: They do not fit together, or are not finite.
        """
        frames, problem = len(self.root_pos) if self.root_pos.ndim else 0, ""
        widths = {"root_pos": 3, "root_quat": 4, "joint_pos": None}
        for name, width in widths.items():
            values = getattr(self, name)
            if values.ndim != 2 or len(values) != frames or width not in (None, values.shape[1]):
                problem = f"{name} has shape {values.shape}, not ({frames}, {width or 'joints'})"
            elif not np.isfinite(values).all():
                problem = (
                    f"{name} is not finite in frame {int(np.argmin(np.isfinite(values).all(1)))}"
                )
            if problem:
                raise DatasetError(f"{self.name}: {problem}")
        if frames < 2:
            raise DatasetError(f"{self.name}: has {frames} frames; a motion needs two")
        if self.fps is not None and not 0 < self.fps < 1e5:
            raise DatasetError(
                f"{self.name}: has {self.fps:g} frames per second; give --source-fps"
            )
        if self.joint_names is not None and len(self.joint_names) != self.joint_pos.shape[1]:
            raise DatasetError(
                f"{self.name}: names {len(self.joint_names)} joints and has"
                f" {self.joint_pos.shape[1]}"
            )


def numbers(value: object, name: str, file: str) -> np.ndarray:
    """A value of a file as an array of float64.

    Raises:
        DatasetError: It is none; the message names the file and the key.
    """
    if isinstance(value, list) and value and isinstance(value[0], list):
        if len(value) * len(value[0]) > MOST_NUMBERS:
            raise DatasetError(f"{file}: {name} has more numbers than a motion")
        if any(not isinstance(row, list) or len(row) != len(value[0]) for row in value):
            raise DatasetError(f"{file}: the rows of {name} differ in length")
        if any(not isinstance(number, int | float) for row in value for number in row):
            raise DatasetError(f"{file}: {name} holds something other than numbers")
    try:
        array = np.asarray(value)
    except ValueError as error:
        raise DatasetError(f"{file}: {name} is no table of numbers") from error
    if array.dtype.kind not in "iuf" or array.size > MOST_NUMBERS:
        raise DatasetError(f"{file}: {name} is no table of numbers")
    return array.astype(np.float64)


def rate(value: object, file: str) -> float:
    """Frames per second: a number, or an array of one.

    Raises:
        DatasetError: It is neither.
    """
    problem = DatasetError(f"{file}: its frames per second are no number")
    try:
        array = np.asarray(value)
    except ValueError as error:  # lists that differ in length
        raise problem from error
    if array.size != 1 or array.dtype.kind not in "iuf":
        raise problem
    return float(array.reshape(-1)[0])
