"""The plan of a recording: where each rollout of a tracker starts, how long it is, where it stops.

A recording has three parts: whole clips, rollouts that start standing, and rollouts that stop.
"""

from __future__ import annotations

from dataclasses import dataclass, fields

import torch

from lacoloco.pipelines.sim.physics import CONTROL_DT
from lacoloco.pipelines.tracking.config import RecordingConfig
from lacoloco.pipelines.tracking.env import NEVER, TrackingEnv

MIN_START_ROWS = 8
"""With fewer rows to start from there are no standing starts."""


@dataclass(frozen=True)
class RolloutPlan:
    """W rollouts, one per world.

    Attributes:
        rows: (W,) row of the reference motion at which a rollout starts.
        steps: (W,) length of the rollout in control steps.
        standing: (W,) bool, whether it starts in the default pose instead of the clip's state.
        stop_at: (W,) control step at which the robot is to stop, ``NEVER`` in most rollouts.
    """

    rows: torch.Tensor
    steps: torch.Tensor
    standing: torch.Tensor
    stop_at: torch.Tensor

    @classmethod
    def following(cls, rows: torch.Tensor, steps: torch.Tensor) -> RolloutPlan:
        """Rollouts that start in the clip's state and do not stop."""
        standing = torch.zeros_like(rows, dtype=torch.bool)
        return cls(rows, steps, standing, torch.full_like(rows, NEVER))


def num_rollouts(clips: int, config: RecordingConfig) -> int:
    """Upper bound of W for a number of clips, the last of which is the robot standing still."""
    return (clips - 1) * config.copies + config.starts + config.stops


def plan_rollouts(env: TrackingEnv, config: RecordingConfig, *, seed: int) -> RolloutPlan:
    """Plan a recording; ``seed`` decides which starts and stops are taken."""
    parts = (
        _whole_clips(env, config),
        _standing_starts(env, config, seed),
        _stops(env, config, seed + 1),
    )
    columns = (
        torch.cat([getattr(part, column.name) for part in parts]) for column in fields(RolloutPlan)
    )
    return RolloutPlan(*columns)


def _whole_clips(env: TrackingEnv, config: RecordingConfig) -> RolloutPlan:
    """Every clip but the last from its first frame to its end, ``copies`` times."""
    states = env.reference.states
    rows = states.first[:-1].repeat(config.copies)
    return RolloutPlan.following(rows, states.remaining[rows])


def _standing_starts(env: TrackingEnv, config: RecordingConfig, seed: int) -> RolloutPlan:
    """Rollouts that start in the default pose where a clip moves slowly."""
    remaining, speed = env.reference.states.remaining, env.reference.speed
    limits = env.base.spec.tracking
    slow = (speed > limits.moving_speed) & (speed < limits.slow_speed)
    candidates = torch.nonzero(slow & (remaining >= _min_steps(config))).flatten()
    rows = _sample(_similar_starts(env, candidates), config.starts, seed)
    steps = remaining[rows].clamp_max(round(config.start_s / CONTROL_DT))
    standing = torch.ones_like(rows, dtype=torch.bool)
    return RolloutPlan(rows, steps, standing, torch.full_like(rows, NEVER))


def _stops(env: TrackingEnv, config: RecordingConfig, seed: int) -> RolloutPlan:
    """Rollouts that start in a moving clip and stop before it ends."""
    remaining, speed = env.reference.states.remaining, env.reference.speed
    moving = speed > env.base.spec.tracking.moving_speed
    candidates = torch.nonzero(moving & (remaining > _min_steps(config))).flatten()
    generator = torch.Generator().manual_seed(seed)
    count = config.stops if len(candidates) else 0
    chosen = torch.randint(max(1, len(candidates)), (count,), generator=generator)
    chance = torch.rand(count, generator=generator).to(candidates.device)
    rows = candidates[chosen.to(candidates.device)]
    earliest, latest = (seconds / CONTROL_DT for seconds in config.stop_after_s)
    stop_at = (earliest + chance * (latest - earliest)).long()
    stop_at = torch.minimum(stop_at, remaining[rows] - 1)
    steps = stop_at + round(config.stand_s / CONTROL_DT)
    return RolloutPlan(rows, steps, torch.zeros_like(rows, dtype=torch.bool), stop_at)


def _similar_starts(env: TrackingEnv, candidates: torch.Tensor) -> torch.Tensor:
    """Those of the rows ``candidates`` (K,) that are alike in pose and in which legs swing.

    A gait can start from standing in any phase. A policy that has seen all phases learns their
    mean, which is to stand. So the rows are taken that swing in one sense along the principal
    component of the joint velocities, and of these the quarter nearest to the default pose.
    """
    if len(candidates) < MIN_START_ROWS:
        return candidates[:0]
    states = env.reference.states
    velocity = states.qvel[candidates, 6:]
    principal = torch.linalg.eigh(velocity.T @ velocity).eigenvectors[:, -1]
    principal = principal * principal[principal.abs().argmax()].sign()
    swing = velocity @ principal
    same_sense = candidates[swing > swing.quantile(0.75)]
    distance = (states.qpos[same_sense, 7:] - env.base.default_joint_pos).norm(dim=1)
    return same_sense[distance.argsort()[: max(1, len(distance) // 4)]]


def _sample(rows: torch.Tensor, count: int, seed: int) -> torch.Tensor:
    """(count,) of ``rows``, drawn with replacement; none where there are none."""
    if not len(rows):
        return rows
    generator = torch.Generator().manual_seed(seed)
    return rows[torch.randint(len(rows), (count,), generator=generator).to(rows.device)]


def _min_steps(config: RecordingConfig) -> int:
    """Control steps of a clip that must be left for a start or a stop."""
    return round(2.0 * config.min_segment_s / CONTROL_DT)
