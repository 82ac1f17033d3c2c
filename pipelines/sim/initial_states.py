"""How episodes begin: inside a clip, or standing.

Who stands has joint angles around the default pose, each with the height that just puts the feet on
the ground. The base height depends on the joint angles: at the default pose's own, spread angles
begin up to 2 cm (Solo12) or 6 cm (H1) inside the floor, and the first step throws the robot into
the air (bug B7 of the original).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import torch

from lacoloco.datasets.rotations import from_yaw, multiply, rotate
from lacoloco.pipelines.sim.commands import Range, uniform
from lacoloco.pipelines.sim.physics import CONTROL_DT
from lacoloco.robots.geometry import standing_height
from lacoloco.robots.spec import RobotSpec

if TYPE_CHECKING:
    from lacoloco.datasets.motion_library import MotionLibrary
    from lacoloco.pipelines.sim.tasks import ResetConfig

POOL = 256
"""Poses drawn once per environment; resets choose among them."""


class StandingStarts:
    """A pool of poses: default joint angles times independent factors from ``joint_scale``."""

    def __init__(
        self, spec: RobotSpec, joint_scale: Range, generator: torch.Generator, device: torch.device
    ) -> None:
        """Draw the pool and measure its heights; the pool has one pose where there is no spread."""
        count = POOL if joint_scale[0] < joint_scale[1] else 1
        joints = len(spec.joint_names)
        scale = uniform((joint_scale,) * joints, count, generator).to(device)
        self.joint_pos = torch.tensor(spec.default_joint_pos, device=device) * scale
        heights = [
            standing_height(spec.model(), pose, spec.feet)
            for pose in self.joint_pos.cpu().numpy().astype(np.float64)
        ]
        self.height = torch.tensor(heights, dtype=torch.float32, device=device)

    def anywhere(
        self, start: ResetConfig, count: int, generator: torch.Generator
    ) -> tuple[torch.Tensor, torch.Tensor]:
        """(count, 7 + J), (count, 6 + J): standing with the feet on the ground, anywhere, any
        heading.
        """
        planar = uniform(
            ((-start.position, start.position),) * 2 + ((-start.heading, start.heading),),
            count,
            generator,
        )
        joint_pos, height = self.draw(count, generator)
        qpos = torch.cat(
            (planar[:, :2], height[:, None], from_yaw(planar[:, 2]), joint_pos), dim=-1
        )
        linear = uniform(((-start.lin_vel, start.lin_vel),) * 3, count, generator)
        angular = uniform(((-start.ang_vel, start.ang_vel),) * 3, count, generator)
        return qpos, torch.cat((linear, angular, torch.zeros_like(joint_pos)), dim=-1)

    def draw(self, count: int, generator: torch.Generator) -> tuple[torch.Tensor, torch.Tensor]:
        """(count, J) joint angles [rad] and (count,) base heights [m]."""
        chosen = torch.randint(
            0, len(self.height), (count,), generator=generator, device=generator.device
        )
        return self.joint_pos[chosen], self.height[chosen]


def clip_starts(
    motions: MotionLibrary, count: int, generator: torch.Generator, *, memory: int = 0
) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
    """(count, 7 + J), (count, 6 + J): a random moment of a random clip, heading re-drawn,
    velocities turned with it; (count, memory) where the expert's clock stood, zeros where nobody
    knows.
    """
    clips, times = motions.sample(count, generator=generator)
    frames = motions.frames(clips, times)
    heading = from_yaw(uniform(((-torch.pi, torch.pi),), count, generator)[:, 0])
    quat = multiply(heading, frames.root_quat)
    position = torch.zeros_like(frames.root_pos)
    position[:, 2] = frames.root_pos[:, 2]
    qpos = torch.cat((position, quat, frames.joint_pos), dim=-1)
    linear = rotate(quat, frames.root_lin_vel_b)
    qvel = torch.cat((linear, frames.root_ang_vel_b, frames.joint_vel), dim=-1)
    known = motions.gait_memory(clips, times, CONTROL_DT).nan_to_num() if memory else qpos[:, :0]
    return qpos, qvel, known
