"""Which skill of the clips a robot's motion is nearest to, moment by moment."""

from __future__ import annotations

from collections.abc import Sequence

import torch

from lacoloco.datasets.clip import Clip
from lacoloco.datasets.motion_library import MotionLibrary
from lacoloco.pipelines.sim.state import RobotState, style_frame

MOMENTS = 512
"""Moments of each skill that motion is compared with; as many of each, so that no skill wins by its
length.
"""
CHUNK = 8192


class NearestClip:
    """Distances to the clips of each skill, in style frames scaled by how much the clips vary in
    each number.
    """

    def __init__(self, clips: Sequence[Clip], *, seed: int = 0) -> None:
        """Draw moments of every skill that the clips have, by duration."""
        self.skills = tuple(dict.fromkeys(clip.skill for clip in clips))
        generator = torch.Generator().manual_seed(seed)
        moments = []
        for skill in self.skills:
            library = MotionLibrary([clip for clip in clips if clip.skill == skill])
            chosen = library.sample(MOMENTS, generator=generator)
            moments.append(style_frame(RobotState.from_motion(library.frames(*chosen))))
        self._scale = torch.cat(moments).std(dim=0).clamp_min(1e-3)
        self._middle = torch.cat(moments).mean(dim=0)
        self._moments = [self._scaled(frames) for frames in moments]

    def distances(self, frames: torch.Tensor) -> torch.Tensor:
        """(n, 10 + 2J) style frames -> (n, skills) distance to the nearest moment of each skill.

        It is the root mean square over the frame's numbers, each in units of its standard deviation
        over the clips.
        """
        parts = []
        for chunk in self._scaled(frames).split(CHUNK):
            nearest = [torch.cdist(chunk, moments).amin(dim=1) for moments in self._moments]
            parts.append(torch.stack(nearest, dim=1))
        return torch.cat(parts) / frames.shape[-1] ** 0.5

    def _scaled(self, frames: torch.Tensor) -> torch.Tensor:
        # Around zero: the distances are computed from products, which cancel where all numbers are
        # far from it.
        return (frames - self._middle) / self._scale
