"""Recorded motion of animals or people: BVH files as points in metres, in a world with z up."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from difflib import get_close_matches
from pathlib import Path
from typing import Literal

import numpy as np

from lacoloco.datasets.errors import DatasetError, storage_errors

UpAxis = Literal["y", "z"]

_FARTHEST = 1e4  # m; a point beyond is a damaged number, not a motion


@dataclass(frozen=True)
class Mocap:
    """Positions of the K nodes of a skeleton (joints and ends of limbs) in T frames."""

    name: str
    fps: float
    joint_names: tuple[str, ...]
    """The nodes in file order, parents before children; the end below joint X is "X_end"."""
    parents: tuple[int, ...]
    """Index of each node's parent, -1 for the root."""
    positions: np.ndarray
    """(T, K, 3) m, world frame with z up."""

    @property
    def frames(self) -> int:
        """Number of frames T."""
        return len(self.positions)

    @property
    def duration(self) -> float:
        """Seconds between the first and the last frame."""
        return (self.frames - 1) / self.fps

    def keypoints(self, names: Sequence[str]) -> np.ndarray:
        """Positions (T, len(names), 3) of some nodes, in m.

        Raises:
            DatasetError: a name that the skeleton has not; the message gives the nearest.
        """
        for name in names:
            if name not in self.joint_names:
                near = get_close_matches(name, self.joint_names, 1, cutoff=0.4)
                hint = f"did you mean '{near[0]}'?" if near else ""
                known = ", ".join(self.joint_names)
                raise DatasetError(
                    f"{self.name}: the skeleton has no joint '{name}'; {hint} It has: {known}"
                )
        return self.positions[:, [self.joint_names.index(name) for name in names]]

    def slice(self, start: int, stop: int) -> Mocap:
        """Frames start to stop (exclusive).

        Raises:
            DatasetError: not within the recording.
        """
        if not 0 <= start < stop <= self.frames:
            raise DatasetError(f"{self.name}: frames {start}:{stop} are not within 0:{self.frames}")
        part = self.positions[start:stop]
        return Mocap(self.name, self.fps, self.joint_names, self.parents, part)


def load_bvh(path: Path, *, up_axis: UpAxis = "y", scale: float = 0.01) -> Mocap:
    """Read a BVH file and compute where its nodes are.

    The root is where its position channels say; its OFFSET, left over from the capture set-up, is
    not added. BVH does not say which axis points up, so it is said here and never guessed:
    with y up, world (x, y, z) = scale * (-x, z, y) of the file, a proper rotation.

    Args:
        path: the file.
        up_axis: axis of the file that points up.
        scale: metres per unit of the file; 0.01 for centimetres.

    Raises:
        DatasetError: missing, empty, not BVH, cut short, without frames, or with values that are
            not finite; the message names the file.
    """
    path = Path(path)
    if up_axis not in ("y", "z"):
        raise DatasetError(f"up_axis '{up_axis}': use 'y' or 'z'")
    if not 0 < scale < np.inf:
        raise DatasetError(f"scale {scale}: give the metres per unit of the file, e.g. 0.01")
    _check_text(path)
    name, fps, joint_names, parents, points = _parse(path)
    if len(set(joint_names)) < len(joint_names):
        raise DatasetError(f"{path}: two joints have the same name; rename one")
    finite = np.isfinite(points).all((1, 2)) & (np.abs(points).max((1, 2)) < _FARTHEST / scale)
    if not finite.all():
        bad = int(np.argmin(finite))
        raise DatasetError(f"{path}: frame {bad} holds a value that is no number or out of range")
    if up_axis == "y":
        points = np.stack([-points[..., 0], points[..., 2], points[..., 1]], axis=-1)
    return Mocap(name, fps, joint_names, parents, points * scale)


def _check_text(path: Path) -> None:
    """Refuse, with the plainest words, what is no BVH file at first sight."""
    if path.is_dir():
        raise DatasetError(f"{path}: is a directory; name a .bvh file in it")
    if not path.exists():
        raise DatasetError(f"{path}: no such file")
    with storage_errors(path, "read"), path.open("rb") as stream:
        start = stream.read(4096)
    if not start.strip():
        raise DatasetError(f"{path}: the file is empty")
    if not start.removeprefix(b"\xef\xbb\xbf").lstrip().startswith(b"HIERARCHY"):
        raise DatasetError(f"{path}: not a BVH file, it does not begin with HIERARCHY")


def _parse(path: Path) -> tuple[str, float, tuple[str, ...], tuple[int, ...], np.ndarray]:
    from pybvh import Bvh

    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # what is wrong is checked and said here
            # The axis is given only to keep it from being guessed; points are in file axes.
            bvh = Bvh.from_file(path, world_up="+y")
            points = bvh.node_positions()
    except Exception as error:  # whatever the parser makes of a bad file, the file is to blame
        reason = " ".join(str(error).replace(f" in file {path}", "").split())
        reason = reason.replace(f" in {path}", "") or type(error).__name__
        raise DatasetError(f"{path}: cannot be read as BVH: {reason}") from error
    if not (len(points) and bvh.frame_time > 0 and np.isfinite(bvh.frame_time)):
        raise DatasetError(f"{path}: has no frames or no positive Frame Time")
    index = {id(node): k for k, node in enumerate(bvh.nodes)}
    parents = tuple(-1 if n.parent is None else index[id(n.parent)] for n in bvh.nodes)
    names = tuple(f"{n.parent.name}_end" if n.is_end_site() else n.name for n in bvh.nodes)
    return path.stem, 1.0 / bvh.frame_time, names, parents, points
