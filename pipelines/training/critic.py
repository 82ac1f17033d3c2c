"""What a critic sees that its policy does not: a critic is only there in training."""

from __future__ import annotations

import torch

from lacoloco.pipelines.sim.env import LeggedEnv
from lacoloco.pipelines.sim.observation import ObservationConfig
from lacoloco.pipelines.sim.views import privileged

PRIVILEGED = "privileged"
"""Observation group of the critic alone; see :func:`lacoloco.pipelines.sim.views.privileged`."""


def critic_only(env: LeggedEnv, config: ObservationConfig) -> dict[str, int]:
    """Observation group -> width, of what only the critic sees."""
    return {name: group.shape[1] for name, group in for_critic(env, config).items()}


def for_critic(env: LeggedEnv, config: ObservationConfig) -> dict[str, torch.Tensor]:
    """Observation group -> (N, width), of what only the critic sees now."""
    return {PRIVILEGED: privileged(env)} if config.resolved().privileged_critic else {}
