"""Robustness of a low level against latents that switch, measured without a high level.

A latent held for 3 s from a standing start tells which skills there are (``skill_coverage.py``),
but not whether they last. One low level fell in 0.2 % of the episodes under latents that were
resampled ten times a second, and in 11 % under latents that were held.
"""

from __future__ import annotations

from dataclasses import replace

import torch

from lacoloco.pipelines.learn.latents import LatentConfig, LatentSchedule
from lacoloco.pipelines.policies import Policy
from lacoloco.pipelines.sim.env import LeggedEnv
from lacoloco.pipelines.sim.physics import CONTROL_DT
from lacoloco.pipelines.sim.tasks import ResetConfig, imitate_task, load_task
from lacoloco.robots.spec import RobotSpec


def latent_switching_robustness(
    spec: RobotSpec, policy: Policy, *, worlds: int = 256, seconds: float = 10.0, seed: int = 0
) -> dict[str, float]:
    """Play ``worlds`` episodes with the randomisation and the pushes of the high level's training.

    Every episode begins standing; its latents switch at a rate of its own, from held to resampled
    ten times a second (:class:`~lacoloco.pipelines.learn.latents.LatentConfig`). Mean actions, no
    noise, motors as strong as they are; the same episodes for the same seed.

    Returns:
        ``switching_fall_rate``, the share of episodes that end in a fall, and
        ``switching_violation_rate``, the share of foot-substeps until then with a contact force
        above the limit.
    """
    device = str(next(policy.actor.parameters()).device)
    task = imitate_task(spec, constrained=False)
    task = replace(
        task,
        episode_s=seconds,
        noise=0.0,
        training_limits=False,
        reset=ResetConfig(),
        randomisation=load_task(spec, "reach").randomisation,
    )
    sees = policy.head.observation
    env = LeggedEnv(spec, task, worlds, seed=seed, device=device, observation=sees)
    latents = LatentSchedule(
        worlds, LatentConfig(dim=policy.head.sizes["latent"]), seed=seed, device=device
    )
    latents.random_walk[:] = True
    alive = torch.ones(worlds, dtype=torch.bool, device=env.device)
    no_reset, limit = torch.zeros_like(alive), spec.foot_force_limit()
    above, lived = torch.zeros((), device=env.device), torch.zeros((), device=env.device)
    for _ in range(round(seconds / CONTROL_DT)):
        fell = env.step(policy(env.observe(), latents.z)).fell
        above += (
            (env.physics.foot_force > limit) & alive[:, None, None]
        ).sum()  # no index: nothing waits for a GPU
        lived += alive.sum() * env.physics.foot_force[0].numel()
        alive = alive & ~fell
        latents.advance(no_reset)
    return {
        "switching_fall_rate": 1.0 - float(alive.float().mean()),
        "switching_violation_rate": float(above / lived),
    }
