"""Actors and critics on rsl_rl's MLP model: normaliser, network and Gaussian head in one exportable
module.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Literal

import torch
from rsl_rl.models import MLPModel
from tensordict import TensorDict
from torch import nn

from lacoloco.datasets.config_values import Length, Std, Widths, Within
from lacoloco.pipelines.learn.cat import ramp
from lacoloco.pipelines.learn.style import StyleInput

Activation = Literal[
    "elu", "selu", "relu", "crelu", "lrelu", "tanh", "sigmoid", "softplus", "gelu", "swish", "mish"
]
"""rsl_rl's names of activation functions."""
LATENT = "latent"
"""The observation group with the latent."""


@dataclass(frozen=True)
class NetworkConfig:
    """Actor and critic.

    Attributes:
        actor: Widths of the actor's hidden layers.
        critic: Widths of the critic's hidden layers.
        activation: Name of the activation function.
        init_std: First standard deviation of the exploration noise [raw action units].
        learn_std: Whether the actor's optimiser also moves that standard deviation, one per action.
            It then follows no schedule.
        style: Widths of the hidden layers of a network between the latent and the actor, as in ASE.
            Empty: the actor sees the latent.
        bounded_mean: Whether the mean action passes a tanh.
    """

    actor: Widths = (256, 128, 64)
    critic: Widths = (256, 128, 64)
    activation: Activation = "elu"
    init_std: Std = 0.35
    learn_std: bool = False
    style: Annotated[tuple[int, ...], Length(0, 8), Within(1, 4096)] = ()
    bounded_mean: bool = False


def make_actor(sizes: dict[str, int], actions: int, config: NetworkConfig) -> MLPModel:
    """Actor over the concatenated observation groups ``sizes`` (name -> width), ``actions``
    outputs, Gaussian.

    Only the group ``policy`` should be unbounded; latents are unit vectors, the normaliser treats
    all alike.
    """
    distribution = {
        "class_name": "GaussianDistribution",
        "init_std": config.init_std,
        "std_type": "log",
        "learn_std": config.learn_std,
    }
    actor = _model(sizes, actions, config.actor, config.activation, distribution)
    with torch.no_grad():
        # Begin with the default pose: a random offset per joint is one more thing to unlearn.
        actor.mlp[-1].weight.mul_(0.05)
        actor.mlp[-1].bias.zero_()
    if config.style and LATENT in sizes:
        columns = list(sizes).index(LATENT)
        first = sum(list(sizes.values())[:columns])
        style = StyleInput(first, sizes[LATENT], config.style, config.activation)
        actor.mlp = nn.Sequential(style, *actor.mlp)
    if config.bounded_mean:
        actor.mlp.append(nn.Tanh())
    return actor


def make_critic(sizes: dict[str, int], config: NetworkConfig) -> MLPModel:
    """Critic over the observation groups ``sizes``, one value per world."""
    return _model(sizes, 1, config.critic, config.activation, None)


def example(sizes: dict[str, int], count: int = 1) -> TensorDict:
    """Zero observations of the right widths, for building models and buffers."""
    return TensorDict(
        {name: torch.zeros(count, size) for name, size in sizes.items()}, batch_size=[count]
    )


def set_std(actor: MLPModel, std: float) -> None:
    """Set the exploration std of every action, if it is not learned."""
    if actor.distribution.log_std_param.requires_grad:
        return
    with torch.no_grad():
        actor.distribution.log_std_param.fill_(float(torch.tensor(std).log()))


def mean_std(actor: MLPModel) -> float:
    """Exploration std, the mean over the actions [raw action units]."""
    return float(actor.distribution.log_std_param.detach().exp().mean())


def geometric(ends: tuple[float, float], share: float) -> float:
    """Geometric interpolation from the first to the second value as ``share`` goes from 0 to 1;
    clamped outside.
    """
    share = min(max(share, 0.0), 1.0)
    return float(ends[0] ** (1.0 - share) * ends[1] ** share)


def annealed(kl_anneal: tuple[float, float, float], progress: float) -> float:
    """Factor on the KL target: 1, then falling geometrically to the first of ``kl_anneal`` while
    the training goes from the second to the third (shares of it).
    """
    final, begin, end = kl_anneal
    return geometric((1.0, final), ramp(progress, begin, end))


def _model(
    sizes: dict[str, int],
    outputs: int,
    hidden: tuple[int, ...],
    activation: str,
    distribution: dict | None,
) -> MLPModel:
    return MLPModel(
        example(sizes),
        {"model": list(sizes)},
        "model",
        outputs,
        hidden_dims=list(hidden),
        activation=activation,
        obs_normalization=True,
        distribution_cfg=distribution,
    )
