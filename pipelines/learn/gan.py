"""The GAN discriminator of ASE: one logit per transition (paper, "Imitation objective")."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import torch
from rsl_rl.modules import MLP
from torch import nn

from lacoloco.datasets.config_values import Factor, Share, Widths, Within
from lacoloco.pipelines.learn.discriminator import classification
from lacoloco.pipelines.learn.networks import Activation


@dataclass(frozen=True)
class GanConfig:
    """Network and regularisers.

    Attributes:
        hidden: Widths of the hidden layers.
        activation: Name of the activation function.
        encoder_shares: Whether the skill encoder is a second last layer on these hidden layers, as
            in ASE. ``ase.encoder_hidden`` then has no meaning.
        noise: Standard deviation of the instance noise (Arjovsky & Bottou, 2017) on normalised
            transitions of both kinds. Without it exploration noise alone tells the policy from a
            demonstration.
        samples: Noise samples per transition; its logit is their mean.
        gradient_penalty: Weight of the gradient penalty. The original's code has 5. Here the logits
            then stay within 0.1 of zero, and the encoder's reward dominates (see LOG.md).
        logit_decay: Weight decay of the last layer.
        max_accuracy: Accuracy above which the discriminator does not learn. A policy that only
            stands is told from clips that stand for a fifth of the time with 89 %. With a limit of
            75 % it may go on standing.
    """

    hidden: Widths = (256, 128)
    activation: Activation = "elu"
    encoder_shares: bool = False
    noise: Annotated[float, Within(0, 1000)] = 1.0
    samples: Annotated[int, Within(1, 1000)] = 4
    gradient_penalty: Factor = 0.02
    logit_decay: Factor = 0.01
    max_accuracy: Share = 0.9


class GanDiscriminator(nn.Module):
    """D(s_t, s_t+1) = sigmoid(MLP), trained by cross-entropy with a gradient penalty on
    demonstrations.
    """

    def __init__(self, transition_dim: int, config: GanConfig) -> None:
        """Build the network for transitions of ``transition_dim`` = 2F numbers."""
        super().__init__()
        self.config = config
        self.mlp = MLP(transition_dim, 1, list(config.hidden), config.activation)

    def logits(self, transition: torch.Tensor, generator: torch.Generator) -> torch.Tensor:
        """(n, 2F) normalised transitions -> (n,) log-odds."""
        shape = (len(transition), self.config.samples, transition.shape[-1])
        noise = torch.randn(shape, generator=generator, device=generator.device)
        return self.mlp(transition[:, None] + self.config.noise * noise).mean(dim=(1, 2))

    def loss(
        self, agent: torch.Tensor, demo: torch.Tensor, generator: torch.Generator
    ) -> tuple[torch.Tensor, dict[str, torch.Tensor]]:
        """Cross-entropy + gradient penalty E_demo |grad_x logit|^2 + decay of the logit layer."""
        demo = demo.detach().requires_grad_(True)
        demo_logits = self.logits(demo, generator)
        bce, metrics = classification(self.logits(agent, generator), demo_logits)
        (slope,) = torch.autograd.grad(demo_logits.sum(), demo, create_graph=True)
        penalty = slope.square().sum(dim=-1).mean()
        decay = self.mlp[-1].weight.square().sum()
        metrics["gradient_penalty"] = penalty.detach()
        return (
            bce + self.config.gradient_penalty * penalty + self.config.logit_decay * decay,
            metrics,
        )
