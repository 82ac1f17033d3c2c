"""How episodes begin: inside a clip, or standing.

Who stands has joint angles around the default pose, each with the height that just puts the feet on
the ground. The base height depends on the joint angles: at the default pose's own, spread angles
begin up to 2 cm (Solo12) or 6 cm (H1) inside the floor, and the first step throws the robot into
the air (bug B7 of the original).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import torch

from lacoloco.datasets.rotations import from_yaw, multiply, rotate
from lacoloco.pipelines.sim.commands import uniform
from lacoloco.pipelines.sim.engines import make_physics
from lacoloco.pipelines.sim.physics import CONTROL_DT, PhysicsRequest
from lacoloco.pipelines.sim.state import RobotState
from lacoloco.robots.geometry import standing_height
from lacoloco.robots.spec import RobotSpec

if TYPE_CHECKING:
    from lacoloco.datasets.motion_library import MotionLibrary
    from lacoloco.pipelines.sim.tasks import ResetConfig

POOL = 256
"""States drawn once per environment; resets choose among them."""
LEANS, SAGS = 0.1, 0.2
"""Tilt [rad] and share of the base's height beyond which a robot no longer stands but falls."""


class StandingStarts:
    """A pool of states: default joint angles times independent factors, and what became of them if
    the robot has stood there for a while.
    """

    def __init__(
        self, spec: RobotSpec, start: ResetConfig, generator: torch.Generator, device: torch.device
    ) -> None:
        """Draw the pool, by ``joint_scale`` and ``stood_s``, and measure its heights; it has one
        state where there is no spread.
        """
        joint_scale, stood = start.joint_scale, start.stood_s
        count = POOL if joint_scale[0] < joint_scale[1] else 1
        joints = len(spec.joint_names)
        scale = uniform((joint_scale,) * joints, count, generator).to(device)
        joint_pos = torch.tensor(spec.default_joint_pos, device=device) * scale
        heights = [
            standing_height(spec.model(), pose, spec.feet)
            for pose in joint_pos.cpu().numpy().astype(np.float64)
        ]
        self.qpos = torch.zeros(count, 7 + joints, device=device)
        self.qpos[:, 2] = torch.tensor(heights, dtype=torch.float32, device=device)
        self.qpos[:, 3], self.qpos[:, 7:] = 1.0, joint_pos
        self.qvel = torch.zeros(count, 6 + joints, device=device)
        if stood[1] > 0.0:
            # No random number: who has stood is asked for the same as who has not.
            every = self.qpos.expand(POOL, -1).clone() if count == 1 else self.qpos
            seconds = torch.linspace(*stood, POOL, device=device)
            self.qpos, self.qvel = _stood(spec, every, seconds)

    def anywhere(
        self, start: ResetConfig, count: int, generator: torch.Generator
    ) -> tuple[torch.Tensor, torch.Tensor]:
        """(count, 7 + J), (count, 6 + J): standing with the feet on the ground, anywhere, any
        heading, given a push as large as ``lin_vel`` and ``ang_vel`` say.
        """
        planar = uniform(
            ((-start.position, start.position),) * 2 + ((-start.heading, start.heading),),
            count,
            generator,
        )
        chosen = torch.randint(
            0, len(self.qpos), (count,), generator=generator, device=generator.device
        )
        qpos, qvel, heading = self.qpos[chosen], self.qvel[chosen], from_yaw(planar[:, 2])
        qpos[:, :2] += planar[:, :2]
        qpos[:, 3:7] = multiply(heading, qpos[:, 3:7])
        linear = uniform(((-start.lin_vel, start.lin_vel),) * 3, count, generator)
        angular = uniform(((-start.ang_vel, start.ang_vel),) * 3, count, generator)
        qvel[:, :3] = rotate(heading, qvel[:, :3]) + linear
        qvel[:, 3:6] += angular
        return qpos, qvel


def _stood(
    spec: RobotSpec, qpos: torch.Tensor, seconds: torch.Tensor
) -> tuple[torch.Tensor, torch.Tensor]:
    """States (K, 7 + J), (K, 6 + J) of the robots of ``qpos`` after they held the default pose for
    ``seconds`` (K,), or for as long as they stood.
    """
    physics = make_physics(PhysicsRequest(spec, len(qpos)), str(qpos.device))
    physics.reset(torch.arange(len(qpos), device=qpos.device), qpos, torch.zeros_like(qpos[:, 1:]))
    held = torch.tensor(spec.default_joint_pos, device=qpos.device).repeat(len(qpos), 1)
    kept, stands = (physics.qpos, physics.qvel), torch.ones_like(seconds, dtype=torch.bool)
    for step in range(round(float(seconds.max()) / CONTROL_DT)):
        physics.step(held)
        state = RobotState.from_generalized(physics.qpos, physics.qvel)
        stands &= state.gravity_b[:, 2] < -math.cos(LEANS)
        stands &= physics.qpos[:, 2] > (1.0 - SAGS) * qpos[:, 2]
        now = (stands & (step * CONTROL_DT < seconds))[:, None]
        kept = (
            torch.where(now, physics.qpos, kept[0]),
            torch.where(now, physics.qvel, kept[1]),
        )
    kept[0][:, :2] = qpos[:, :2]  # where it began is where its episode begins
    return kept


@dataclass(frozen=True)
class ClipStarts:
    """Where K episodes begin.

    Attributes:
        qpos: (K, 7 + J) generalised positions.
        qvel: (K, 6 + J) generalised velocities.
        joint_target: (K, J) where the motors were asked to go a control step before [rad], NaN
            where nobody knows.
        memory: (K, 3) where the expert's gait clock stood, likewise.
    """

    qpos: torch.Tensor
    qvel: torch.Tensor
    joint_target: torch.Tensor
    memory: torch.Tensor


def clip_starts(motions: MotionLibrary, count: int, generator: torch.Generator) -> ClipStarts:
    """A random moment of a random clip each, heading re-drawn, velocities turned with it."""
    clips, times = motions.sample(count, generator=generator)
    frames = motions.frames(clips, times)
    heading = from_yaw(uniform(((-torch.pi, torch.pi),), count, generator)[:, 0])
    quat = multiply(heading, frames.root_quat)
    position = torch.zeros_like(frames.root_pos)
    position[:, 2] = frames.root_pos[:, 2]
    qpos = torch.cat((position, quat, frames.joint_pos), dim=-1)
    linear = rotate(quat, frames.root_lin_vel_b)
    qvel = torch.cat((linear, frames.root_ang_vel_b, frames.joint_vel), dim=-1)
    before = (times - CONTROL_DT).clamp(min=0.0)
    return ClipStarts(
        qpos,
        qvel,
        motions.joint_targets(clips, before, CONTROL_DT),
        motions.gait_memory(clips, times, CONTROL_DT),
    )
