"""Episodes of the reach task, recorded step by step, for playback, export and pictures."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import torch

from lacoloco.pipelines.learn.latents import LatentConfig, LatentSchedule, project
from lacoloco.pipelines.policies import load_policies, steered, task_of
from lacoloco.pipelines.robot import robot_of
from lacoloco.pipelines.sim.disturbances.config import UNDISTURBED
from lacoloco.pipelines.sim.env import LeggedEnv
from lacoloco.pipelines.sim.hierarchical_env import HOLD_STEPS
from lacoloco.pipelines.sim.physics import CONTROL_DT
from lacoloco.pipelines.sim.randomisation import NO_RANDOMISATION
from lacoloco.pipelines.sim.tasks import ResetConfig, imitate_task
from lacoloco.pipelines.stage import SILENT, Progress, track_steps

PLAYING = "playing episodes"


@dataclass(frozen=True)
class ReachRecording:
    """T control steps of each of E episodes.

    Attributes:
        qpos: (E, T, 7 + J) root position [m], quaternion wxyz, joints [rad].
        target: (E, T, 3) world target [m]; None where the task has none.
        end_effector: (E, T, 3) world [m].
        contact: (E, T, F) bool, feet on the ground.
        steering: (E, T, d) unit latent in force.
        low_obs: (T E, P) low-level observations, step by step, with ``latent`` (T E, d) the latents
            beside them.
        high_obs: (T E / 5, H) high-level observations, decision by decision.
        frame: (E, T, 10 + 2J) clean style frame.
        action: (E, T, J) raw actions of the joints.
        fell: (E,) bool.
    """

    qpos: np.ndarray
    target: np.ndarray | None
    end_effector: np.ndarray
    contact: np.ndarray
    steering: np.ndarray
    low_obs: np.ndarray
    latent: np.ndarray
    high_obs: np.ndarray
    frame: np.ndarray
    action: np.ndarray
    fell: np.ndarray
    robot: str
    fps: float = 1.0 / CONTROL_DT


@dataclass(frozen=True)
class LowRecording:
    """T control steps of each of E episodes of a low level alone; fields as in
    :class:`ReachRecording`.
    """

    qpos: np.ndarray
    contact: np.ndarray
    steering: np.ndarray
    fell: np.ndarray
    robot: str
    fps: float = 1.0 / CONTROL_DT


def record_low(
    policy: Path,
    *,
    seconds: float = 10.0,
    episodes: int = 1,
    seed: int = 0,
    changing: bool = False,
    progress: Progress = SILENT,
) -> LowRecording:
    """Play a low level from a standing start, without noise, pushes or randomisation, steered by
    latents drawn from ``seed``.

    Each episode holds one latent to its end; ``changing`` ones are drawn anew after random times,
    as in training.

    Raises:
        ArtifactError: ``policy`` is missing, damaged, or holds no low level.
    """
    artifact, policies = load_policies(policy, "low")
    low, spec = policies["low"], robot_of(artifact)
    task = replace(
        imitate_task(spec, constrained=False),
        noise=0.0,
        training_limits=False,
        randomisation=NO_RANDOMISATION,
        reset=ResetConfig(heading=0.0, lin_vel=0.0, ang_vel=0.0, joint_scale=(1.0, 1.0)),
    )
    env = LeggedEnv(spec, task, episodes, seed=seed, observation=low.head.observation)
    steps = max(1, round(seconds / CONTROL_DT))
    held = (
        LatentConfig(low.head.sizes["latent"])
        if changing
        else LatentConfig(low.head.sizes["latent"], steps, steps)
    )
    latents = LatentSchedule(episodes, held, seed=seed)
    fell = torch.zeros(episodes, dtype=torch.bool)
    qpos, contact, steering = [], [], []
    for _ in track_steps(progress, PLAYING, steps):
        steering.append(latents.z)
        fell |= env.step(low(env.observe(), latents.z)).fell
        qpos.append(env.physics.qpos)
        contact.append(env.feet.contact)
        latents.advance(torch.zeros_like(fell))
    return LowRecording(
        qpos=_stacked(qpos),
        contact=_stacked(contact),
        steering=_stacked(steering),
        fell=fell.numpy(),
        robot=spec.name,
    )


def record_reach(
    policy: Path,
    *,
    seconds: float = 10.0,
    episodes: int = 1,
    seed: int = 0,
    progress: Progress = SILENT,
) -> ReachRecording:
    """Play a high-level artifact's policies on the task that they were trained on, without noise,
    pushes or randomisation, motors as strong as they are.

    Raises:
        ArtifactError: ``policy`` is missing, damaged, or holds no high level.
    """
    artifact, policies = load_policies(policy, "low", "high")
    spec = robot_of(artifact)
    task = replace(
        task_of(artifact, spec),
        noise=0.0,
        training_limits=False,
        randomisation=NO_RANDOMISATION,
        disturbances=UNDISTURBED,
    )
    env = steered(LeggedEnv(spec, task, episodes, seed=seed), policies)
    rows: dict[str, list[torch.Tensor]] = {
        name: []
        for name in ("qpos", "target", "end_effector", "contact", "steering", "frame", "action")
    }
    low_obs, high_obs = [], []
    fell = torch.zeros(episodes, dtype=torch.bool)

    def keep(base: LeggedEnv) -> None:
        values = (
            base.physics.qpos,
            base.command.clone(),
            base.end_effector(),
            base.feet.contact,
            env.latent,
            base.frame(),
            base.action[:, : spec.num_joints],
        )
        for name, value in zip(rows, values, strict=True):
            rows[name].append(value)
        low_obs.append(env.observe_low())

    decisions = max(1, round(seconds / CONTROL_DT / HOLD_STEPS))
    for _ in track_steps(progress, PLAYING, decisions):
        high_obs.append(env.observe())
        fell |= env.step(project(policies["high"](high_obs[-1])), keep).fell
    return ReachRecording(
        qpos=_stacked(rows["qpos"]),
        target=_stacked(rows["target"]) if task.has_target else None,
        end_effector=_stacked(rows["end_effector"]),
        contact=_stacked(rows["contact"]),
        steering=_stacked(rows["steering"]),
        low_obs=torch.cat(low_obs).numpy(),
        latent=torch.cat(rows["steering"]).numpy(),
        high_obs=torch.cat(high_obs).numpy(),
        frame=_stacked(rows["frame"]),
        action=_stacked(rows["action"]),
        fell=fell.numpy(),
        robot=spec.name,
    )


def _stacked(steps: list[torch.Tensor]) -> np.ndarray:
    """(E, T, ...) of T steps of E episodes."""
    return torch.stack(steps, dim=1).numpy()
