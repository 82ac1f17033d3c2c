"""A latent for every piece of a clip: what the policy's latents mean before any skill was
discovered.

The paper's latents mean nothing at first; skill discovery gives them a meaning while the policy
learns to move at all. With recorded clips the two can be separated: a window of a clip is mapped to
the sphere together with a policy that must recover the clip's actions from it (a conditional
autoencoder), and the latents are kept uniform, because uniform ones are what the policy will be
given. Discovery then goes on from there.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Annotated

import torch
from rsl_rl.modules import MLP
from torch import nn

from lacoloco.datasets.config_values import Widths, Within
from lacoloco.pipelines.learn.latents import project


@dataclass(frozen=True)
class WindowConfig:
    """What one latent describes.

    Attributes:
        steps: Length of a window [control steps].
        ahead: The latent of a window stands for every moment of its first part of this length
            [control steps]. So it says which skill is shown, not at which phase of it.
        frames: Equally spaced frames of a window that the embedding sees.
        hidden: Widths of the embedding's hidden layers.
    """

    steps: Annotated[int, Within(1, 10_000)] = 50
    ahead: Annotated[int, Within(0, 10_000)] = 25
    frames: Annotated[int, Within(1, 1000)] = 8
    hidden: Widths = (256, 128)

    def conflict(self) -> str:
        """What does not fit together, "" if all does."""
        if self.ahead <= self.steps:
            return ""
        return f"ahead={self.ahead}: use at most steps = {self.steps}"


@dataclass(frozen=True)
class FlattenedClips:
    """Style frames of all clips in a row: (M, F), and the row of the last frame of the clip that
    each belongs to (M,).
    """

    frames: torch.Tensor
    last: torch.Tensor


class SkillEmbedding(nn.Module):
    """Windows of a timeline -> unit latents."""

    def __init__(self, timeline: FlattenedClips, latent_dim: int, config: WindowConfig) -> None:
        """Build an ELU MLP over normalised frames; the timeline itself is not part of the state."""
        super().__init__()
        frames = timeline.frames
        mean, std = frames.mean(dim=0), frames.std(dim=0).clamp_min(1e-3)
        self.config, self.dim = config, latent_dim
        self._last, self._normalized = timeline.last, (frames - mean) / std
        self._offsets = (
            torch.linspace(0, config.steps, config.frames, device=frames.device).round().long()
        )
        width = frames.shape[1] * config.frames
        self.mlp = MLP(width, latent_dim, list(config.hidden), "elu").to(frames.device)

    def forward(self, starts: torch.Tensor) -> torch.Tensor:
        """(n,) rows at which windows begin -> (n, dim) latents; a window that leaves its clip
        repeats the last frame.
        """
        return project(self.points(starts))

    def points(self, starts: torch.Tensor) -> torch.Tensor:
        """The same before they are projected to the sphere."""
        rows = torch.minimum(starts[:, None] + self._offsets, self._last[starts][:, None])
        points: torch.Tensor = self.mlp(self._normalized[rows].flatten(1))
        return points

    def moments(self, starts: torch.Tensor, generator: torch.Generator) -> torch.Tensor:
        """(n,) rows, each drawn from the moments for which the latent of the window at ``starts``
        stands.

        The last frame of a clip is never among them: every moment has a next frame.
        """
        ahead = torch.randint(
            0, self.config.ahead + 1, starts.shape, generator=generator, device=generator.device
        )
        return torch.minimum(starts + ahead, self._last[starts] - 1)


class LabelledTransitions:
    """Demonstrated transitions with the latents of their windows, for a skill encoder to agree
    with.
    """

    def __init__(
        self,
        timeline: FlattenedClips,
        embedding: SkillEmbedding,
        starts: Callable[[int], torch.Tensor],
    ) -> None:
        """``starts(n)`` draws n rows of the timeline."""
        self.frames, self.embedding, self.starts = timeline.frames, embedding, starts

    @torch.no_grad()
    def __call__(self, count: int, generator: torch.Generator) -> tuple[torch.Tensor, torch.Tensor]:
        """(count, 2F) raw transitions, older frame first, and (count, dim) latents."""
        starts = self.starts(count)
        rows = self.embedding.moments(starts, generator)
        return torch.cat((self.frames[rows], self.frames[rows + 1]), dim=-1), self.embedding(starts)


def uniformity(z: torch.Tensor) -> torch.Tensor:
    """Scalar log E exp(-2 |z - z'|^2) over pairs of (n, dim) unit vectors: least for the uniform
    distribution.

    Wang & Isola, "Understanding Contrastive Representation Learning through Alignment and
    Uniformity" (2020).
    """
    # |z - z'|^2 = 2 - 2 z.z' on the sphere. This takes a third of the time of all distances, which
    # was more than half of a step of cloning.
    count = len(z)
    cosines = (z @ z.T).fill_diagonal_(-torch.inf)
    return ((4.0 * cosines - 4.0).exp().sum() / (count * (count - 1))).log()
