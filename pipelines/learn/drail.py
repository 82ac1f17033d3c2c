"""The diffusion discriminator: which label lets a denoiser explain a transition better (paper
section III-C; DRAIL).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import torch
from torch import nn

from lacoloco.datasets.config_values import PositiveFactor, Rising, Share, Within
from lacoloco.pipelines.learn.discriminator import classification


@dataclass(frozen=True)
class DrailConfig:
    """Denoiser and sampling.

    Attributes:
        hidden: Width of each hidden layer.
        layers: Number of hidden layers.
        steps: Diffusion steps T.
        samples: Stratified diffusion times per transition.
        times: Range of the diffusion times, as shares of T. Near 0 the denoiser sees a transition
            almost as it is, and exploration noise alone tells the policy from a demonstration.
        scale: Factor on the difference of the two losses. Both are means over 2F dimensions, so
            that their difference alone stays in the flat part of the sigmoid. The paper sums, the
            original's code averages.
        max_accuracy: Accuracy above which the discriminator does not learn.
    """

    hidden: Annotated[int, Within(1, 4096)] = 128
    layers: Annotated[int, Within(1, 16)] = 3
    steps: Annotated[int, Within(2, 100_000)] = 1000
    samples: Annotated[int, Within(1, 1000)] = 4
    times: Annotated[tuple[float, float], Within(0, 1), Rising()] = (0.3, 0.8)
    scale: PositiveFactor = 10.0
    max_accuracy: Share = 0.9


class DrailDiscriminator(nn.Module):
    """D = sigmoid(scale (L(x, policy) - L(x, expert))), both losses at the *same* diffusion times
    and noises.

    With common draws an uninformed network gives exactly 0, whatever it predicts; the original's
    independent draws leave a noise of +-0.5 in every logit. Stratified times (one
    per quantile of the schedule) reduce the rest.
    """

    def __init__(self, transition_dim: int, config: DrailConfig) -> None:
        """Build the label-conditioned denoiser for transitions of ``transition_dim`` = 2F
        numbers.
        """
        super().__init__()
        self.config = config
        self.entry = nn.Linear(transition_dim, config.hidden)
        self.label = nn.Embedding(2, config.hidden)
        self.time = nn.Embedding(config.steps, config.hidden)
        self.hidden = nn.ModuleList(
            nn.Linear(config.hidden, config.hidden) for _ in range(config.layers - 1)
        )
        self.exit = nn.Linear(config.hidden, transition_dim)
        nn.init.normal_(self.time.weight, std=0.5)
        nn.init.normal_(self.label.weight, std=0.5)
        self.alpha_bar: torch.Tensor
        self.register_buffer("alpha_bar", cosine_schedule(config.steps))

    def logits(self, transition: torch.Tensor, generator: torch.Generator) -> torch.Tensor:
        """(n, 2F) normalised transitions -> (n,) log-odds of being a demonstration."""
        count, samples = len(transition), self.config.samples
        times = self._times(count, generator)
        noise = torch.randn(
            count, samples, transition.shape[-1], generator=generator, device=generator.device
        )
        keep = self.alpha_bar[times][..., None]
        noisy = keep.sqrt() * transition[:, None] + (1.0 - keep).sqrt() * noise
        # The entry layer sees the same input under both labels: compute it once.
        shared = self.entry(noisy) + self.time(times)
        errors = [
            (self._denoise(shared + self.label.weight[label]) - noise).square().mean(dim=(1, 2))
            for label in (0, 1)
        ]
        return self.config.scale * (errors[0] - errors[1])

    def loss(
        self, agent: torch.Tensor, demo: torch.Tensor, generator: torch.Generator
    ) -> tuple[torch.Tensor, dict[str, torch.Tensor]]:
        """Cross-entropy of the logits; the denoiser is trained by nothing else (paper, after eq. of
        D_diffusion).
        """
        logits = self.logits(torch.cat((agent, demo)), generator)
        return classification(logits[: len(agent)], logits[len(agent) :])

    def _denoise(self, embedded: torch.Tensor) -> torch.Tensor:
        activation = nn.functional.relu(embedded)
        for layer in self.hidden:
            activation = nn.functional.relu(layer(activation))
        return self.exit(activation)

    def _times(self, count: int, generator: torch.Generator) -> torch.Tensor:
        """(count, samples) integer diffusion times, one uniform draw in each of ``samples`` equal
        strata of the range.
        """
        samples, steps = self.config.samples, self.config.steps
        low, high = self.config.times
        offset = torch.rand(count, samples, generator=generator, device=generator.device)
        strata = (torch.arange(samples, device=generator.device) + offset) / samples
        return ((low + (high - low) * strata) * steps).long().clamp_max(steps - 1)


def cosine_schedule(steps: int, offset: float = 0.008) -> torch.Tensor:
    """(steps,) cumulative signal share alpha_bar of Nichol & Dhariwal (2021), betas clipped to
    [1e-4, 0.9999].
    """
    phase = (
        (torch.arange(steps + 1, dtype=torch.float64) / steps + offset)
        / (1.0 + offset)
        * (torch.pi / 2.0)
    )
    signal = torch.cos(phase).square()
    betas = (1.0 - signal[1:] / signal[:-1]).clamp(1e-4, 0.9999)
    return torch.cumprod(1.0 - betas, dim=0).float()
