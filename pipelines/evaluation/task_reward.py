"""The measure of a pair of policies on a task without a target: what the task pays them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import torch

from lacoloco.pipelines.learn.latents import project
from lacoloco.pipelines.policies import Policy, steered
from lacoloco.pipelines.sim.env import LeggedEnv
from lacoloco.pipelines.sim.hierarchical_env import HOLD_STEPS
from lacoloco.pipelines.sim.physics import CONTROL_DT
from lacoloco.pipelines.sim.tasks import Task
from lacoloco.robots.spec import RobotSpec


def task_reward(
    spec: RobotSpec,
    task: Task,
    policies: Mapping[str, Policy],
    *,
    episodes: int,
    seed: int,
    device: str = "cpu",
) -> dict[str, float]:
    """Play one episode in each of ``episodes`` worlds, motors as strong as they are, noise off.

    Without a policy ``high`` every decision is a random latent.

    Returns:
        ``task_reward``, the mean reward per second of an episode's full length, where a fall ends
        the earning; ``falls_pct``, the share of episodes that end in a fall [%];
        ``diverged``, how many of them because the physics diverged;
        ``contact_violation_pct``, the share of foot-substeps above the limit on the force [%];
        ``contact_violation_original_pct``, the same by the original's estimator, per foot [%].
    """
    task = replace(task, noise=0.0, training_limits=False)
    env = steered(LeggedEnv(spec, task, episodes, seed=seed, device=device), policies)
    generator = torch.Generator().manual_seed(seed)
    alive = torch.ones(episodes, dtype=torch.bool, device=env.device)
    fell, diverged = torch.zeros_like(alive), torch.zeros_like(alive)
    earned = torch.zeros(episodes, device=env.device)
    above, lived = torch.zeros_like(earned), torch.zeros_like(earned)
    sampled_above, sampled = torch.zeros_like(earned), torch.zeros_like(earned)
    decisions = task.episode_steps // HOLD_STEPS
    for _ in range(decisions):
        if "high" in policies:
            raw = policies["high"](env.observe())
        else:
            raw = torch.randn(env.latent.shape, generator=generator).to(env.device)
        decision = env.step(project(raw))
        earned += decision.reward * alive
        above += decision.above_limit.mean(dim=1) * alive
        lived += decision.substeps * alive
        sampled_above += decision.sampled_above.float().mean(dim=1) * alive
        sampled += decision.sampled & alive
        fell |= decision.fell & alive
        diverged |= decision.diverged & alive
        alive &= ~decision.done
    # A decision's reward is the mean over its control steps of what each was paid for its 0.02 s.
    return {
        "task_reward": float(earned.mean()) / decisions / CONTROL_DT,
        "diverged": int(diverged.sum()),
        "falls_pct": 100.0 * float(fell.float().mean()),
        "contact_violation_pct": 100.0 * float(above.sum() / lived.sum().clamp_min(1.0)),
        "contact_violation_original_pct": 100.0
        * float(sampled_above.sum() / sampled.sum().clamp_min(1.0)),
    }
