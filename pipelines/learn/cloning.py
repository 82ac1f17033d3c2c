"""Behaviour cloning: fit an actor's mean to recorded actions, whatever the latent."""

from __future__ import annotations

import torch
from rsl_rl.models import MLPModel
from tensordict import TensorDict

from lacoloco.pipelines.learn.latents import sample_latents


def clone(
    actor: MLPModel,
    frames: torch.Tensor,
    previous: torch.Tensor,
    actions: torch.Tensor,
    noise: torch.Tensor,
    *,
    latent_dim: int,
    action_noise: float,
    steps: int,
    batch: int = 4096,
    learning_rate: float = 1e-3,
    draw: torch.Generator,
) -> float:
    """Minimise the squared error of the mean action; the normaliser learns the same observations.

    The observations are as noisy as the policy's own and the last action as noisy as its exploration, so that the fitted
    policy forgives both. Latents are random: what they mean is left to the skill discovery that follows.

    Args:
        actor: over the groups ``policy`` (frame, last action) and ``latent``.
        frames: (M, F) clean style frames.
        previous: (M, A) actions before.
        actions: (M, A) actions to reproduce.
        noise: (F + A,) half-ranges of the uniform observation noise.
        latent_dim: dimension of z.
        action_noise: standard deviation added to ``previous``.
        steps: gradient steps.
        batch: rows per step.
        learning_rate: Adam's, falling linearly to zero.
        draw: source of randomness, on the device of ``frames``.

    Returns:
        Root mean squared error of the last batch, in action units.
    """

    def observe(rows: torch.Tensor) -> TensorDict:
        last = previous[rows] + action_noise * torch.randn(previous[rows].shape, generator=draw, device=draw.device)
        clean = torch.cat((frames[rows], last), dim=-1)
        spread = 2.0 * torch.rand(clean.shape, generator=draw, device=draw.device) - 1.0
        latent = sample_latents(len(rows), latent_dim, draw)
        return TensorDict({"policy": clean + spread * noise, "latent": latent}, batch_size=[len(rows)])

    def pick(count: int) -> torch.Tensor:
        return torch.randint(0, len(frames), (count,), generator=draw, device=draw.device)

    actor.update_normalization(observe(pick(4 * batch)))
    optimizer = torch.optim.Adam(actor.mlp.parameters(), lr=learning_rate, fused=True)
    error = torch.zeros(())
    for step in range(steps):
        optimizer.param_groups[0]["lr"] = learning_rate * (1.0 - step / steps)
        rows = pick(batch)
        error = (actor(observe(rows)) - actions[rows]).square().mean()
        optimizer.zero_grad(set_to_none=True)
        error.backward()
        optimizer.step()
    return float(error.detach().sqrt())
