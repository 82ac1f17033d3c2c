"""From a file to the motion that is retargeted: axes, units, part, rate, mirror image, and
course.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

from lacoloco.datasets.mocap import Mocap, UpAxis, read_bvh
from lacoloco.pipelines.retargeting.mocap.bending import bent
from lacoloco.pipelines.retargeting.mocap.trim import trimmed


@dataclass(frozen=True)
class Reading:
    """How a file is read; kept with each clip, so that a viewer reads it the same way."""

    up_axis: UpAxis = "y"
    unit: float = 0.01
    """Metres per unit of the file."""
    source_fps: float = 0.0
    """Frames per second of the file; 0 for those that it names."""
    trim: str = ""
    fps: float = 0.0
    """Frames per second of the clip; 0 for those of the file."""
    mirror: bool = False
    bend: float = 0.0
    """1/m by which the course is bent to the left, after mirroring."""
    swap_sides: bool = False
    """Left and right are exchanged in the file."""
    pairs: tuple[tuple[str, str], ...] = ()
    """Nodes that belong to each other left and right."""

    def of(self, path: Path) -> Mocap:
        """Read a file.

        Raises:
            DatasetError: It cannot be read, or nothing is left of it.
            StageError: The trim is none.
        """
        return self.apply(read_bvh(path))

    def apply(self, raw: Mocap) -> Mocap:
        """Take the motion out of a recording in the axes and units of its file.

        Raises:
            DatasetError: Nothing is left of it, or an impossible axis, unit, rate or bend.
            StageError: The trim is none.
        """
        if self.source_fps:
            raw = replace(raw, fps=self.source_fps)
        mocap = trimmed(raw.placed(self.up_axis, self.unit), self.trim)
        if self.swap_sides:
            mocap = replace(mocap, positions=mocap.mirrored(self.pairs).positions * [1, -1, 1])
        if self.mirror:
            mocap = mocap.mirrored(self.pairs)
        mocap = bent(mocap, self.bend)
        return mocap.resampled(self.fps) if self.fps else mocap
