"""Actions for clips that have none, and a policy that begins with them.

A clip says how a robot moved, not what its motors were asked for. Both engines can answer that: put a world into every
recorded state, ask for joint targets, and correct them until the next recorded state comes out (inverse dynamics by
simulation). A policy fitted to those actions goes on in whatever motion it finds itself in, and adversarial training
starts from there instead of from a robot that has to discover walking by accident.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch

from lacoloco.datasets import rotations
from lacoloco.datasets.clip import Clip
from lacoloco.pipelines.sim.engines import make_physics
from lacoloco.pipelines.sim.physics import CONTROL_DT, PhysicsRequest
from lacoloco.pipelines.sim.state import RobotState, style_frame
from lacoloco.robots.spec import RobotSpec

ITERATIONS = 6
GAIN_POSITION, GAIN_VELOCITY = 1.2, 0.025
"""Correction of a joint target per rad and per rad/s of error [rad]: damped Gauss-Newton for a joint that answers a
changed target by a third of it in position and by 15 1/s of it in velocity within one control step (Solo12 in the air)."""
BOUND = 1.0
"""Largest |action| that is taken from a clip."""


@dataclass(frozen=True)
class RecordedActions:
    """M consecutive moments of clips: (M, 10 + 2J) style frames, (M, J) actions and (M, J) the actions before them."""

    frames: torch.Tensor
    actions: torch.Tensor
    previous: torch.Tensor


def infer_actions(spec: RobotSpec, clips: Sequence[Clip], action_scale: float, device: str = "cpu") -> RecordedActions:
    """Find the raw actions that take every frame of the clips to its next one, at the control rate.

    Clips of another rate are resampled first. The world is the model's own, without randomisation.
    """
    parts = [_states(clip if abs(clip.fps * CONTROL_DT - 1.0) < 1e-4 else clip.resample(1.0 / CONTROL_DT)) for clip in clips]
    qpos, qvel = (torch.cat(column).to(device) for column in zip(*parts, strict=True))
    first = torch.zeros(len(qpos), dtype=torch.bool, device=device)
    first[np.cumsum([0, *(len(part[0]) for part in parts[:-1])])] = True
    has_next = ~torch.roll(first, -1)
    actions = torch.zeros(len(qpos), len(spec.joint_names), device=device)
    chosen = torch.nonzero(has_next).flatten()
    physics = make_physics(PhysicsRequest(spec, min(1024, len(chosen))), device)
    for rows in chosen.split(physics.num_worlds):
        actions[rows] = _solve(spec, physics, qpos, qvel, rows, action_scale)
    useful = has_next & ~first
    frames = style_frame(RobotState.from_generalized(qpos, qvel))
    return RecordedActions(frames[useful], actions[useful], torch.roll(actions, 1, dims=0)[useful])


def _states(clip: Clip) -> tuple[torch.Tensor, torch.Tensor]:
    linear = rotations.rotate(clip.root_quat, clip.root_lin_vel_b)
    qpos = np.concatenate([clip.root_pos, clip.root_quat, clip.joint_pos], axis=1)
    qvel = np.concatenate([linear, clip.root_ang_vel_b, clip.joint_vel], axis=1)
    return torch.from_numpy(qpos).float(), torch.from_numpy(qvel).float()


def _solve(
    spec: RobotSpec, physics: object, qpos: torch.Tensor, qvel: torch.Tensor, rows: torch.Tensor, action_scale: float
) -> torch.Tensor:
    """(K, J) actions for the moments ``rows``, worlds beyond K idle in the last state."""
    padded = torch.cat((rows, rows[-1:].expand(physics.num_worlds - len(rows))))
    worlds = torch.arange(physics.num_worlds, device=rows.device)
    default = torch.tensor(spec.default_joint_pos, device=rows.device)
    lead = torch.tensor(spec.damping, device=rows.device) / torch.tensor(spec.stiffness, device=rows.device)
    wanted_q, wanted_v = qpos[padded + 1, 7:], qvel[padded + 1, 6:]
    target = wanted_q + lead * wanted_v
    for _ in range(ITERATIONS):
        physics.reset(worlds, qpos[padded], qvel[padded])
        physics.step(target)
        correction = GAIN_POSITION * (wanted_q - physics.qpos[:, 7:]) + GAIN_VELOCITY * (wanted_v - physics.qvel[:, 6:])
        target = target + 0.7 * correction
    return ((target - default) / action_scale).clamp(-BOUND, BOUND)[: len(rows)]
