"""Standing starts: joint angles around the default pose, each with the height that just puts the feet on the ground.

The base height depends on the joint angles: at the default pose's own, spread angles begin up to 2 cm (Solo12) or 6 cm
(H1) inside the floor, and the first step throws the robot into the air (facts 9.2, B7).
"""

from __future__ import annotations

import numpy as np
import torch

from lacoloco.pipelines.sim.commands import Range, uniform
from lacoloco.robots.geometry import standing_height
from lacoloco.robots.spec import RobotSpec

POOL = 256
"""Poses drawn once per environment; resets choose among them."""


class StandingStarts:
    """A pool of poses: default joint angles times independent factors from ``joint_scale``."""

    def __init__(self, spec: RobotSpec, joint_scale: Range, draw: torch.Generator, device: torch.device) -> None:
        """Draw the pool and measure its heights; the pool has one pose where there is no spread."""
        count = POOL if joint_scale[0] < joint_scale[1] else 1
        joints = len(spec.joint_names)
        scale = uniform((joint_scale,) * joints, count, draw).to(device)
        self.joint_pos = torch.tensor(spec.default_joint_pos, device=device) * scale
        heights = [standing_height(spec.model(), pose, spec.feet) for pose in self.joint_pos.cpu().numpy().astype(np.float64)]
        self.height = torch.tensor(heights, dtype=torch.float32, device=device)

    def draw(self, count: int, draw: torch.Generator) -> tuple[torch.Tensor, torch.Tensor]:
        """(count, J) joint angles [rad] and (count,) base heights [m]."""
        chosen = torch.randint(0, len(self.height), (count,), generator=draw, device=draw.device)
        return self.joint_pos[chosen], self.height[chosen]
