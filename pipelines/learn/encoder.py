"""The skill encoder q(z | s_t, s_t+1) ~ exp(kappa mu_q . z) and its reward (paper, "Skill Discovery
Objective").
"""

from __future__ import annotations

import torch
from rsl_rl.modules import MLP
from torch import nn

from lacoloco.pipelines.learn.latents import project


class SkillEncoder(nn.Module):
    """Predicts the mean direction mu_q (n, dim) of the von Mises-Fisher distribution from a
    transition (n, 2F).
    """

    def __init__(
        self,
        transition_dim: int,
        latent_dim: int,
        hidden: tuple[int, ...] = (256, 128),
        activation: str = "elu",
        trunk: nn.Sequential | None = None,
    ) -> None:
        """Build an MLP whose output is projected to the sphere.

        Args:
            transition_dim: 2F.
            latent_dim: Width of a latent.
            hidden: Widths of the hidden layers.
            activation: rsl_rl's name of their activation function.
            trunk: Another network, whose hidden layers are taken instead: the same weights, which
                both then train. It ends in a linear layer.
        """
        super().__init__()
        self.mlp: nn.Module = MLP(transition_dim, latent_dim, list(hidden), activation)
        if trunk is not None:
            *hidden_layers, last = trunk
            assert isinstance(last, nn.Linear), "a network without a last layer has no width"
            self.mlp = nn.Sequential(*hidden_layers, nn.Linear(last.in_features, latent_dim))

    def forward(self, transition: torch.Tensor) -> torch.Tensor:
        """(n, 2F) normalised transitions -> (n, dim) unit vectors."""
        return project(self.mlp(transition))


def cosine(predicted: torch.Tensor, z: torch.Tensor) -> torch.Tensor:
    """(n,) mu_q . z, the log-likelihood up to kappa and a constant."""
    return (predicted * z).sum(dim=-1)


def encoder_reward(predicted: torch.Tensor, z: torch.Tensor) -> torch.Tensor:
    """(n,) max(0, mu_q . z): the paper's log q with kappa = 1, floored as in the original (facts
    4).
    """
    return cosine(predicted, z).clamp_min(0.0)


def encoder_loss(predicted: torch.Tensor, z: torch.Tensor) -> torch.Tensor:
    """Scalar: minus the mean log-likelihood."""
    return -cosine(predicted, z).mean()
