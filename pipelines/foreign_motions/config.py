"""What a foreign motion does not say of itself, and how it becomes a clip."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Literal

from lacoloco.datasets.config_values import Within


@dataclass(frozen=True)
class ImportConfig:
    """Config of `motions import`."""

    fps: Annotated[float, Within(1.0, 1000.0)] = 50.0
    """Frames per second of the clips; those of the policies."""
    source_fps: Annotated[float, Within(0.0, 100_000.0)] = 0.0
    """Frames per second of the files; 0: as they say."""
    quaternion: Literal["", "wxyz", "xyzw"] = ""
    """Order of the orientation's columns; empty: as the format has it, or the only upright one."""
    joints: str = ""
    """Order of the joints: model, breadth-first, legs, names joined by commas, or a file of them;
    empty: as the file or its format says.
    """
    keep_height: bool = False
    """Leave the motion at its height; else the feet are put on the ground."""
    skill: str = "imported"
    """Group of the clips, for weights and reports."""
    licence: str = ""
    """Licence of the files, kept with the clips."""
