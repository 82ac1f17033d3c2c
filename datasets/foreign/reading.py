"""Any file with a motion: which reader is for it."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from lacoloco.datasets.errors import DatasetError
from lacoloco.datasets.foreign.frames import read_frames
from lacoloco.datasets.foreign.motion import ForeignMotion
from lacoloco.datasets.foreign.npz import read_npz
from lacoloco.datasets.foreign.pickled import read_pickled
from lacoloco.datasets.foreign.tables import read_csv

READERS: dict[str, Callable[[Path], ForeignMotion]] = {
    ".npz": read_npz,
    ".csv": read_csv,
    ".txt": read_frames,
    ".json": read_frames,
    ".pkl": read_pickled,
    ".pickle": read_pickled,
}
"""Ending -> reader."""


def read_motion(path: Path) -> ForeignMotion:
    """The motion of a file, in the columns that it has there.

    Raises:
        DatasetError: No such file, an ending that no format has, or what its reader refuses.
    """
    if not path.is_file():
        reason = "is no regular file" if path.exists() else "no such file"
        raise DatasetError(f"{path}: {reason}; name a file that ends in {', '.join(READERS)}")
    reader = READERS.get(path.suffix.lower())
    if reader is None:
        hint = "; lacoloco retarget takes it" if path.suffix.lower() == ".bvh" else ""
        raise DatasetError(
            f"{path}: no motion ends like this{hint}; known are {', '.join(READERS)}"
        )
    return reader(path)
