"""The network between a latent and the actor of ASE (Peng et al. 2022)."""

from __future__ import annotations

import torch
from rsl_rl.modules import MLP
from torch import nn


class StyleInput(nn.Module):
    """Replaces the latent in an actor's input by tanh(MLP(latent)), of the same width.

    It is the first layer of the actor's network, so that it is stored and exported with it.

    Args:
        first: Column at which the latent begins.
        width: Width of the latent.
        hidden: Widths of the hidden layers.
        activation: rsl_rl's name of their activation function.
    """

    def __init__(self, first: int, width: int, hidden: tuple[int, ...], activation: str) -> None:
        """Begin with styles over all of (-1, 1), as ASE does: small ones would be ignored."""
        super().__init__()
        self.first, self.end = first, first + width
        self.mlp = MLP(width, width, list(hidden), activation, last_activation="tanh")
        exit_layer = self.mlp[-2]
        nn.init.uniform_(exit_layer.weight, -1.0, 1.0)
        nn.init.zeros_(exit_layer.bias)

    def forward(self, observation: torch.Tensor) -> torch.Tensor:
        """(..., D) -> (..., D), the latent's columns replaced."""
        before, after = observation[..., : self.first], observation[..., self.end :]
        style = self.mlp(observation[..., self.first : self.end])
        return torch.cat((before, style, after), dim=-1)
