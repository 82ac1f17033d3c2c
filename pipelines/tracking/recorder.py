"""Recording of a tracker: rollouts as planned, cut into segments that become clips."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import cast

import numpy as np
import torch

from lacoloco.datasets.clip import Clip
from lacoloco.pipelines.errors import StageError
from lacoloco.pipelines.policies import Policy
from lacoloco.pipelines.sim.physics import CONTROL_DT
from lacoloco.pipelines.tracking.config import RecordingConfig
from lacoloco.pipelines.tracking.env import TrackingEnv
from lacoloco.pipelines.tracking.rollout_plan import RolloutPlan, plan_rollouts
from lacoloco.pipelines.tracking.segments import cut_rests, is_resting, split_at_terminations


@dataclass(frozen=True)
class Rollouts:
    """W rollouts of T control steps.

    Attributes:
        series: Field of :class:`~lacoloco.datasets.clip.Clip` -> (W, T + 1, ...) values.
        terminated: (W, T) bool, early terminations.
        reward: (W, T) in [0, 1].
    """

    series: dict[str, np.ndarray]
    terminated: torch.Tensor
    reward: torch.Tensor


def record(
    env: TrackingEnv, clips: Sequence[Clip], policy: Policy, config: RecordingConfig, *, seed: int
) -> tuple[list[Clip], dict[str, float]]:
    """Follow the clips as planned, with mean actions, and cut the rollouts into segments.

    Args:
        env: At least :func:`~lacoloco.pipelines.tracking.rollout_plan.num_rollouts` worlds over
            the same clips.
        clips: The reference clips.
        policy: The tracker.
        config: What to record.
        seed: Which starts and stops are taken.

    Returns:
        The segments as clips, and metrics: the number of ``segments``; ``kept``, the share of the
        recorded time that they hold; the number of ``early_terminations``; the mean reward; mean
        planar speed of the clips and of the segments [m/s].

    Raises:
        StageError: No segment is long enough.
    """
    plan = plan_rollouts(env, config, seed=seed)
    rollouts = _roll_out(env, plan, policy)
    segments = _segments(env, clips, plan, rollouts, config)
    if not segments:
        raise StageError("the tracker lost every clip too soon; train it longer")
    active = torch.arange(rollouts.terminated.shape[1]) < plan.steps.cpu()[:, None]
    recorded_s = CONTROL_DT * float(plan.steps.sum())
    return segments, {
        "segments": len(segments),
        "kept": sum(segment.duration for segment in segments) / recorded_s,
        "early_terminations": float((rollouts.terminated & active).sum()),
        "reward_recorded": float(rollouts.reward[active].mean()),
        "clip_speed": float(env.reference.speed.mean()),
        "speed": _mean_speed(segments),
    }


def _roll_out(env: TrackingEnv, plan: RolloutPlan, policy: Policy) -> Rollouts:
    """Roll the tracker out as planned.

    After an early termination a rollout goes on where it is, in the clip's own state. Worlds that
    the plan does not use copy the first rollout without its stop; their series are dropped.
    """
    count, base = len(plan.rows), env.base
    unused = env.num_worlds - count
    rows = torch.cat((plan.rows, plan.rows[:1].expand(unused)))
    standing = torch.cat((plan.standing, plan.standing.new_zeros(unused)))
    base.episode_steps.fill_(int(env.reference.states.last.max()) + 2)
    env.reset_to(torch.ones_like(standing), rows, standing)
    env.stop_at[:count] = plan.stop_at
    frames, targets, terminations, rewards = [_frame(env)], [], [], []
    for _ in range(int(plan.steps.max())):
        _, reward, terminated, _ = env.step(
            policy(*cast("Iterable[torch.Tensor]", env.observe().values()))
        )
        targets.append(base.default_joint_pos + base.task.action_scale * base.action)
        env.reset_to(terminated, env.rows, torch.zeros_like(terminated))
        frames.append(_frame(env))
        terminations.append(terminated.cpu())
        rewards.append(reward.cpu())
    columns = {name: [frame[name] for frame in frames] for name in frames[0]}
    columns["joint_target"] = [*targets, targets[-1]]
    series = {
        name: torch.stack(column, dim=1)[:count].cpu().numpy() for name, column in columns.items()
    }
    return Rollouts(
        series, torch.stack(terminations, dim=1)[:count], torch.stack(rewards, dim=1)[:count]
    )


def _segments(
    env: TrackingEnv,
    clips: Sequence[Clip],
    plan: RolloutPlan,
    rollouts: Rollouts,
    config: RecordingConfig,
) -> list[Clip]:
    """All segments that are worth keeping, as clips."""
    clip_of = torch.searchsorted(env.reference.states.first, plan.rows, right=True) - 1
    segments = []
    for world, steps in enumerate(plan.steps.tolist()):
        clip = clips[int(clip_of[world])]
        series = {name: values[world] for name, values in rollouts.series.items()}
        resting = is_resting(series, env.base.spec.tracking)
        terminated = rollouts.terminated[world, :steps]
        for span in split_at_terminations(terminated, bool(plan.standing[world]), config):
            for start, stop in cut_rests(resting, span, config):
                name = f"{clip.name}_{world:03d}_{start:04d}"
                cut = {field: values[start:stop] for field, values in series.items()}
                segments.append(_clip(clip, name, cut))
    return segments


def _frame(env: TrackingEnv) -> dict[str, torch.Tensor]:
    """The robots' states in one moment, named like the series of a clip."""
    state = env.base.state
    names = ("root_pos", "root_quat", "joint_pos", "joint_vel")
    named = {name: getattr(state, name).clone() for name in names}
    return named | {
        "root_lin_vel_b": state.lin_vel_b.clone(),
        "root_ang_vel_b": state.ang_vel_b.clone(),
    }


def _clip(source: Clip, name: str, series: dict[str, np.ndarray]) -> Clip:
    about = f"lacoloco track: {source.name}" + (f" ({source.source})" if source.source else "")
    return Clip(
        name=name,
        fps=1.0 / CONTROL_DT,
        joint_names=source.joint_names,
        skill=source.skill,
        weight=source.weight,
        source=about,
        licence=source.licence,
        **series,
    )


def _mean_speed(segments: Sequence[Clip]) -> float:
    """Mean planar speed of the base over all frames [m/s]."""
    planar = torch.cat([torch.as_tensor(segment.root_lin_vel_b[:, :2]) for segment in segments])
    return float(planar.norm(dim=-1).mean())
