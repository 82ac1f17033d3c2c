"""Recording of an expert: rollouts from a standing start, one clip per world."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
import torch

from lacoloco.datasets.clip import Clip
from lacoloco.pipelines.errors import StageError
from lacoloco.pipelines.generation.config import GenerateConfig
from lacoloco.pipelines.generation.expert_trainer import without_disturbances
from lacoloco.pipelines.policies import Policy
from lacoloco.pipelines.sim.env import LeggedEnv
from lacoloco.pipelines.sim.physics import CONTROL_DT
from lacoloco.pipelines.sim.state import RobotState
from lacoloco.pipelines.sim.tasks import ResetConfig, load_task
from lacoloco.pipelines.stage import StageContext
from lacoloco.robots.spec import RobotSpec

SKILLS = {"walk": "walk", "reach_in_place": "reach"}
"""Task of an expert -> skill name of its clips."""
LICENCE = "BSD-3-Clause (made by lacoloco)"


def record(
    spec: RobotSpec,
    task_name: str,
    policy: Policy,
    count: int,
    config: GenerateConfig,
    context: StageContext,
) -> tuple[list[Clip], dict[str, float | None]]:
    """Record ``count`` clips of one expert, with mean actions, without noise or pushes, each in its
    own world.

    Every clip starts with the robot standing still: nothing else shows how walking or reaching
    starts. More worlds than clips are run, and only worlds without a fall are kept, so no clip
    contains a reset.

    Returns:
        The clips, and by skill: ``<skill>_error_mean`` [m/s, or m for reaching] over all steps,
        ``<skill>_error_settled`` at the last moment of each command, ``<skill>_yaw_error_...``
        [rad/s] for a walking task, ``<skill>_falls`` of ``<skill>_worlds``.

    Raises:
        StageError: Fewer than ``count`` worlds stayed up.
    """
    steps, transient = round(config.seconds / CONTROL_DT), round(config.transient_s / CONTROL_DT)
    base = without_disturbances(load_task(spec, task_name))
    task = replace(base, reset=standing_starts(base.reset), episode_s=2 * config.seconds)
    env = LeggedEnv(
        spec, task, count + max(8, count // 4), seed=context.seed, device=context.device
    )
    upright = torch.ones(env.num_worlds, dtype=torch.bool, device=env.device)
    rows, asked, errors, ended = [_row(env)], [], [], []
    for step in range(steps):
        command = env.command.clone()
        outcome = env.step(policy(env.observe()))
        asked.append((env.joint_target, command))
        upright &= ~outcome.fell
        rows.append(_row(env))
        if step >= transient:
            errors.append(_tracking_error(env, command))
            ended.append((env.command != command).any(dim=-1))
    kept = torch.nonzero(upright).flatten()
    skill = SKILLS[task_name]
    if len(kept) < count:
        raise StageError(
            f"the {skill} expert fell in {env.num_worlds - len(kept)} of {env.num_worlds} "
            "recordings; train it longer"
        )
    names = ("error", "yaw_error") if env.task.name == "walk" else ("error",)
    metrics: dict[str, float | None] = {}
    for name, column in zip(names, torch.stack(errors).unbind(dim=-1), strict=True):
        # At the last moment of each command; the mean over all steps includes the way there.
        last = column[torch.stack(ended)]
        metrics[f"{skill}_{name}_mean"] = float(column.mean())
        metrics[f"{skill}_{name}_settled"] = float(last.mean()) if len(last) else None
    metrics[f"{skill}_falls"] = float((~upright).sum())
    metrics[f"{skill}_worlds"] = float(env.num_worlds)
    weight = config.reach_weight if skill == "reach" else 1.0
    joint_target, commands = (
        torch.stack([*column, column[-1]], dim=1).cpu().numpy()
        for column in zip(*asked, strict=True)
    )
    chosen = enumerate(kept[:count].tolist())
    return [
        _clip(spec, skill, weight, index, rows, joint_target[world], commands[world], world)
        for index, world in chosen
    ], metrics


def standing_starts(reset: ResetConfig) -> ResetConfig:
    """Start still, near the default pose."""
    return replace(reset, joint_scale=(0.9, 1.1), lin_vel=0.0, ang_vel=0.0, gait_share=0.0)


def _tracking_error(env: LeggedEnv, command: torch.Tensor) -> torch.Tensor:
    """(N, 2) errors of planar velocity [m/s] and yaw rate [rad/s] of a walking task, (N, 1) of the
    end effector [m] of a reaching one, for ``command`` (N, 3).
    """
    if env.task.name != "walk":
        return torch.linalg.vector_norm(env.end_effector() - command, dim=-1, keepdim=True)
    off = torch.cat((env.state.lin_vel_b[:, :2], env.state.ang_vel_b[:, 2:]), dim=-1) - command
    speed = torch.linalg.vector_norm(off[:, :2], dim=-1)
    return torch.stack((speed, off[:, 2].abs()), dim=-1)


def _row(env: LeggedEnv) -> tuple[torch.Tensor, RobotState, torch.Tensor | None]:
    memory = None if env.guide is None else env.guide.clock.memory()
    return env.physics.qpos, env.state, memory


def _clip(
    spec: RobotSpec,
    skill: str,
    weight: float,
    index: int,
    rows: Sequence[tuple[torch.Tensor, RobotState, torch.Tensor | None]],
    joint_target: np.ndarray,
    command: np.ndarray,
    world: int,
) -> Clip:
    def series(pick: Callable[..., torch.Tensor]) -> np.ndarray:
        return torch.stack([pick(*row)[world] for row in rows]).cpu().numpy()

    return Clip(
        name=f"{skill}_{index:03d}",
        fps=1.0 / CONTROL_DT,
        joint_names=spec.joint_names,
        root_pos=series(lambda qpos, *_: qpos[:, :3]),
        root_quat=series(lambda qpos, *_: qpos[:, 3:7]),
        root_lin_vel_b=series(lambda _, state, *__: state.lin_vel_b),
        root_ang_vel_b=series(lambda _, state, *__: state.ang_vel_b),
        joint_pos=series(lambda qpos, *_: qpos[:, 7:]),
        joint_vel=series(lambda _, state, *__: state.joint_vel),
        joint_target=joint_target,
        command=command,
        gait_memory=None if rows[0][2] is None else series(lambda *row: row[2]),
        skill=skill,
        weight=weight,
        source=f"lacoloco generate: {skill} expert",
        licence=LICENCE,
    )
