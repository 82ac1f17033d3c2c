"""Recorded motion of animals or people: BVH files as points in metres, in a world with z up."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from difflib import get_close_matches
from pathlib import Path
from typing import Literal

import numpy as np

from lacoloco.datasets.bvh import parse_bvh
from lacoloco.datasets.errors import DatasetError

UpAxis = Literal["x", "y", "z", "-x", "-y", "-z"]

_TO_WORLD: dict[str, tuple[tuple[int, int], ...]] = {
    # (axis of the file, sign) of world x, y, z; each a proper rotation
    "x": ((1, 1), (2, 1), (0, 1)),
    "y": ((0, -1), (2, 1), (1, 1)),
    "z": ((0, 1), (1, 1), (2, 1)),
    "-x": ((2, 1), (1, 1), (0, -1)),
    "-y": ((0, 1), (2, 1), (1, -1)),
    "-z": ((0, 1), (1, -1), (2, -1)),
}

_FARTHEST = 1e7  # ten kilometres in millimetres; beyond is a damaged number, not a motion


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
    remarks: tuple[str, ...] = ()
    """What was put up with when it was read, one line each."""

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
        return replace(self, positions=self.positions[start:stop])

    def placed(self, up_axis: UpAxis, scale: float) -> Mocap:
        """A recording in the axes and units of its file, with z up and in metres.

        Args:
            up_axis: Axis of the file that points up; with y, world (x, y, z) is (-x, z, y).
            scale: Metres per unit of the file.

        Raises:
            DatasetError: No such axis, or an impossible scale.
        """
        if up_axis not in _TO_WORLD:
            raise DatasetError(f"up_axis '{up_axis}': use one of {', '.join(_TO_WORLD)}")
        if not 0 < scale < np.inf:
            raise DatasetError(f"scale {scale}: give the metres per unit of the file, e.g. 0.01")
        columns = [sign * self.positions[..., axis] for axis, sign in _TO_WORLD[up_axis]]
        return replace(self, positions=scale * np.stack(columns, axis=-1))

    def resampled(self, fps: float) -> Mocap:
        """The same motion at another rate, on cubics through the frames (Catmull-Rom).

        The last frame is the last one within the duration.

        Raises:
            DatasetError: fps is not positive.
        """
        if not 0 < fps < np.inf:
            raise DatasetError(f"{self.name}: cannot resample to {fps} frames per second")
        last = self.frames - 1
        times = np.arange(int(np.floor(self.duration * fps + 1e-6)) + 1) * (self.fps / fps)
        low = np.clip(times.astype(int), 0, max(last - 1, 0))
        high, share = np.minimum(low + 1, last), (times - low)[:, None, None]
        values = self.positions
        slopes = np.gradient(values, axis=0) if last else np.zeros_like(values)
        step = values[high] - values[low]
        bend = (1 - share) * (slopes[low] - step) - share * (slopes[high] - step)
        positions = values[low] + share * step + share * (1 - share) * bend
        return replace(self, fps=float(fps), positions=positions)

    def mirrored(self, pairs: Sequence[tuple[str, str]]) -> Mocap:
        """The mirror image at the plane y = 0, in which left stays left.

        Args:
            pairs: Nodes that change sides with each other.
        """
        order = list(range(len(self.joint_names)))
        for one, other in pairs:
            a, b = self.joint_names.index(one), self.joint_names.index(other)
            order[a], order[b] = b, a
        return replace(self, positions=self.positions[:, order] * [1.0, -1.0, 1.0])


def axis_of_file(up_axis: UpAxis, axis: int, sign: int) -> str:
    """Name ("y", "-z") of the axis of a file that became an axis of the world.

    Args:
        up_axis: With which the file was read.
        axis: 0, 1, 2 for world x, y, z.
        sign: 1, or -1 for its opposite.
    """
    source, own_sign = _TO_WORLD[up_axis][axis]
    return ("-" if sign * own_sign < 0 else "") + "xyz"[source]


def load_bvh(path: Path, *, up_axis: UpAxis = "y", scale: float = 0.01) -> Mocap:
    """Read a BVH file and compute where its nodes are.

    BVH does not say which axis points up, so it is said here and never guessed.

    Args:
        path: the file.
        up_axis: axis of the file that points up.
        scale: metres per unit of the file; 0.01 for centimetres.

    Raises:
        DatasetError: see `read_bvh` and `Mocap.placed`.
    """
    path = Path(path)
    return read_bvh(path).placed(up_axis, scale)


def read_bvh(path: Path) -> Mocap:
    """Read a BVH file as it is, its nodes in the axes and units of the file.

    The root is where its position channels say; its OFFSET, left over from the capture set-up, is
    not added. So it is with position channels of other joints.

    Raises:
        DatasetError: missing, empty, not BVH, cut short, without frames, or with values that are
            not finite; the message names the file.
    """
    path = Path(path)
    if path.is_dir():
        raise DatasetError(f"{path}: is a directory; name a .bvh file in it")
    if not path.is_file():
        reason = "is no regular file" if path.exists() else "no such file"
        raise DatasetError(f"{path}: {reason}")
    bvh = parse_bvh(path)
    points = bvh.node_positions()
    with np.errstate(invalid="ignore"):
        sound = (np.isfinite(points) & (np.abs(points) < _FARTHEST)).all((1, 2))
    if not sound.all():
        bad = int(np.argmin(sound))
        raise DatasetError(f"{path}: frame {bad} holds a value that is no number or out of range")
    names = tuple(node.name for node in bvh.nodes)
    parents = tuple(node.parent for node in bvh.nodes)
    return Mocap(path.stem, 1.0 / bvh.frame_time, names, parents, points, bvh.remarks)
