"""Steadiness: how a low level fares while it is steered, before there is anybody to steer it.

A latent held for 3 s from a standing start tells which skills there are (``coverage.py``), not
whether they last: of one low level 0.2 % of the episodes ended in a fall under latents drawn anew
ten times a second, 11 % under latents that were held.
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


def steadiness(
    spec: RobotSpec, policy: Policy, *, worlds: int = 256, seconds: float = 10.0, seed: int = 0
) -> dict[str, float]:
    """What becomes of ``worlds`` episodes in worlds and under pushes as a high level will meet
    them.

    Every episode begins standing; its latents wander at a pace of its own, from held to drawn anew
    ten times a second (:class:`~lacoloco.pipelines.learn.latents.LatentConfig`). Mean actions, no
    noise; the same episodes for the same seed.

    Returns:
        ``steered_falls``, the share that end in a fall, and ``steered_violation``, the share of
        foot-substeps until then with a contact force above the limit.
    """
    device = str(next(policy.actor.parameters()).device)
    task = imitate_task(spec, constrained=False)
    task = replace(
        task,
        episode_s=seconds,
        noise=0.0,
        reset=ResetConfig(),
        randomisation=load_task(spec, "reach").randomisation,
    )
    env = LeggedEnv(spec, task, worlds, seed=seed, device=device)
    latents = LatentSchedule(
        worlds, LatentConfig(dim=policy.head.sizes["latent"]), seed=seed, device=device
    )
    latents.random_walk[:] = True
    alive = torch.ones(worlds, dtype=torch.bool, device=env.device)
    nobody, limit = torch.zeros_like(alive), spec.foot_force_limit()
    above, lived = torch.zeros((), device=env.device), torch.zeros((), device=env.device)
    for _ in range(round(seconds / CONTROL_DT)):
        fell = env.step(policy(env.observe(), latents.z)).fell
        above += (
            (env.physics.foot_force > limit) & alive[:, None, None]
        ).sum()  # no index: nothing waits for a GPU
        lived += alive.sum() * env.physics.foot_force[0].numel()
        alive = alive & ~fell
        latents.advance(nobody)
    return {
        "steered_falls": 1.0 - float(alive.float().mean()),
        "steered_violation": float(above / lived),
    }
