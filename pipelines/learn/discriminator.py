"""What the two discriminators share: the contract, the normaliser of their input, and the imitation
reward.
"""

from __future__ import annotations

from typing import Protocol

import torch
from rsl_rl.modules import EmpiricalNormalization
from torch import nn

CLIP = 5.0
"""Normalised transitions are clipped to +-5, as in the original."""


class DiscriminatorConfig(Protocol):
    """What every discriminator is told.

    Attributes:
        max_accuracy: it learns only while it is right less often than this. Left alone it is right
            95 % of the time within a million samples and then tells the policy nothing (the reward
            falls to 0.03 of its ln 2).
    """

    max_accuracy: float


class Discriminator(Protocol):
    """Tells demonstrations from the policy; inputs are normalised transitions (n, 2F), oldest frame
    first.
    """

    config: DiscriminatorConfig

    def logits(self, transition: torch.Tensor, generator: torch.Generator) -> torch.Tensor:
        """(n,) log-odds that a transition is a demonstration; D = sigmoid(logits)."""

    def loss(
        self, agent: torch.Tensor, demo: torch.Tensor, generator: torch.Generator
    ) -> tuple[torch.Tensor, dict]:
        """Scalar loss to minimise, and what to log: accuracies and mean logits as 0-d tensors."""

    def parameters(self) -> object:
        """Trainable parameters."""


def imitation_reward(logits: torch.Tensor, ceiling: float = 5.0) -> torch.Tensor:
    """(n,) r_D = -log(1 - D) = softplus(logit), at most ``ceiling`` (the original's 1e-4 floor on 1
    - D gives 9.2).
    """
    return nn.functional.softplus(logits).clamp_max(ceiling)


def classification(
    agent: torch.Tensor, demo: torch.Tensor
) -> tuple[torch.Tensor, dict[str, torch.Tensor]]:
    """Binary cross-entropy of agent (n,) and demonstration (m,) logits, each class averaged, and
    its statistics.
    """
    bce = 0.5 * (nn.functional.softplus(agent).mean() + nn.functional.softplus(-demo).mean())
    with torch.no_grad():
        metrics = {
            "agent_accuracy": (agent < 0).float().mean(),
            "demo_accuracy": (demo > 0).float().mean(),
            "agent_logit": agent.mean(),
            "demo_logit": demo.mean(),
            "margin": demo.mean() - agent.mean(),
        }
    return bce, metrics


class TransitionNormalizer(nn.Module):
    """Running per-feature statistics of single frames, applied to both frames of a transition.

    One set of statistics for both frames keeps their difference meaningful (the original keeps
    two). They are taken from demonstrations and policy in equal parts: scaled by the
    demonstrations alone, the small features in which an untrained policy differs (height, tilt)
    become many standard deviations and the discriminator saturates.
    """

    def __init__(self, frame_dim: int) -> None:
        """Start with no statistics for frames of ``frame_dim`` = F features."""
        super().__init__()
        self.statistics = EmpiricalNormalization(frame_dim)

    def update(self, agent: torch.Tensor, demo: torch.Tensor) -> None:
        """Take in raw transitions (n, 2F) of both kinds."""
        count = min(len(agent), len(demo))
        both = torch.cat((agent[:count], demo[:count]))
        self.statistics.update(both.view(2 * len(both), -1))

    def forward(self, transition: torch.Tensor) -> torch.Tensor:
        """(n, 2F) -> normalised and clipped."""
        frames = transition.view(-1, 2, transition.shape[-1] // 2)
        return self.statistics(frames).clamp(-CLIP, CLIP).view(transition.shape)
