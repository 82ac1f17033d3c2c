"""Which clip a motion is nearest to, by name."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path

import numpy as np
import torch

from lacoloco.datasets.clip import Clip, load_clips
from lacoloco.datasets.motion_library import MotionLibrary
from lacoloco.pipelines.errors import StageError
from lacoloco.pipelines.policies import motions_of
from lacoloco.pipelines.sim.state import RobotState, style_frame

MOMENTS = 24
"""Of each clip, equally spaced."""


def clips_at_hand(policy: Path, motions: Sequence[Path], robot: str) -> list[Clip]:
    """The clips of the motions named, else those that a policy was made of; none if they are gone.

    Raises:
        ArtifactError: Motions are damaged, or of another robot.
    """
    if not motions:
        with suppress(StageError):
            motions = motions_of(policy)
    return [clip for path in motions for clip in load_clips(path, robot=robot)]


class ClipNames:
    """Moments of clips, as style frames scaled by how much the clips vary in each number."""

    def __init__(self, clips: Sequence[Clip]) -> None:
        """Take the moments."""
        library = MotionLibrary(clips)
        self._names = [f"{clip.name} ({clip.skill})" if clip.skill else clip.name for clip in clips]
        self._clip = torch.arange(len(clips)).repeat_interleave(MOMENTS)
        share = torch.linspace(0.0, 1.0, MOMENTS).repeat(len(clips))
        frames = library.frames(self._clip, share * library.durations[self._clip])
        moments = style_frame(RobotState.from_motion(frames))
        self._middle, self._scale = moments.mean(dim=0), moments.std(dim=0).clamp_min(1e-3)
        self._moments = (moments - self._middle) / self._scale

    def nearest(self, frames: np.ndarray) -> str:
        """The clip to which most of the style frames (T, 10 + 2J) are nearest."""
        scaled = (torch.as_tensor(frames) - self._middle) / self._scale
        found = self._clip[torch.cdist(scaled, self._moments).argmin(dim=1)]
        return self._names[int(found.mode().values)]
