"""How good an expert is: episodes from a standing start, with motors as strong as they are and the
pushes of its task.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import torch

from lacoloco.pipelines.generation.expert_trainer import without_noise
from lacoloco.pipelines.generation.recorder import SKILLS, standing_starts
from lacoloco.pipelines.policies import Policy
from lacoloco.pipelines.sim.env import LeggedEnv
from lacoloco.pipelines.sim.physics import CONTROL_DT
from lacoloco.pipelines.sim.tasks import Task, load_task
from lacoloco.robots.spec import RobotSpec

SMOOTHING_S = 0.3
"""Time constant of the velocities that are compared with the command [s]: a base sways within a
step."""


def assess(
    spec: RobotSpec,
    task_name: str,
    policy: Policy,
    *,
    worlds: int,
    seconds: float,
    transient_s: float,
    seed: int,
    device: str,
) -> dict[str, float | None]:
    """Play ``worlds`` episodes of an expert, mean actions, commands changing as in training.

    Returns:
        By skill: ``<skill>_falls_pct``, the share of episodes that end in a fall [%];
        ``<skill>_velocity_error`` [m/s] and ``<skill>_yaw_error`` [rad/s], means over the steps
        before a fall and after ``transient_s``; ``<skill>_target_error`` [m], mean at the last
        moment of each command, None if none ended.
    """
    task = _assessed(load_task(spec, task_name), seconds)
    env = LeggedEnv(spec, task, worlds, seed=seed, device=device)
    upright = torch.ones(worlds, dtype=torch.bool, device=env.device)
    mean = torch.zeros(worlds, 3, device=env.device)
    errors: list[torch.Tensor] = []
    for step in range(round(seconds / CONTROL_DT)):
        command = env.command.clone()
        upright &= ~env.step(policy(env.observe())).fell
        state = env.state
        velocity = torch.cat((state.lin_vel_b[:, :2], state.ang_vel_b[:, 2:]), dim=1)
        mean += CONTROL_DT / SMOOTHING_S * (velocity - mean)
        if step * CONTROL_DT < transient_s:
            continue
        if task.has_target:
            ended = upright & (env.command != command).any(dim=1)
            errors.append(torch.linalg.vector_norm(env.end_effector() - command, dim=1)[ended])
        else:
            errors.append((mean - command)[upright])
    skill = SKILLS[task_name]
    falls: dict[str, float | None] = {
        f"{skill}_falls_pct": 100.0 * float((~upright).float().mean())
    }
    off = torch.cat(errors) if errors else torch.zeros(0)
    if task.has_target:
        return falls | {f"{skill}_target_error": float(off.mean()) if len(off) else None}
    return falls | {
        f"{skill}_velocity_error": float(torch.linalg.vector_norm(off[:, :2], dim=1).mean()),
        f"{skill}_yaw_error": float(off[:, 2].abs().mean()),
    }


def assessed(metrics: Mapping[str, float | None]) -> dict[str, float | None]:
    """What :func:`assess` found, of all metrics of experts; older ones have none."""
    return {name: metrics[name] for name in metrics if name.endswith(_ENDINGS)}


_ENDINGS = ("_falls_pct", "_velocity_error", "_yaw_error", "_target_error")


def _assessed(task: Task, seconds: float) -> Task:
    return replace(
        without_noise(task),
        reset=standing_starts(task.reset),
        episode_s=2.0 * seconds,
        training_limits=False,
    )
