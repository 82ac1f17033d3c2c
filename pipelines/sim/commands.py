"""What a task asks of the robot: a velocity to track, or a point to touch."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import torch

from lacoloco.datasets.rotations import rotate_inverse
from lacoloco.pipelines.sim.state import RobotState

Range = tuple[float, float]


@dataclass(frozen=True)
class VelocityCommand:
    """Planar velocity in the base's heading: uniform ranges [m/s, m/s, rad/s]; a share of worlds is
    told to stand.
    """

    forward: Range
    lateral: Range
    yaw_rate: Range
    standing: float = 0.02

    def sample(self, origin: torch.Tensor, draw: torch.Generator) -> torch.Tensor:
        """(K, 3) new commands for K worlds; ``origin`` (K, 3) only gives the count."""
        command = uniform((self.forward, self.lateral, self.yaw_rate), len(origin), draw)
        moving = torch.rand(len(origin), generator=draw, device=draw.device) >= self.standing
        return command * moving[:, None]

    def observe(self, command: torch.Tensor, state: RobotState) -> torch.Tensor:
        """(N, 3) the command itself: it is already relative to the base."""
        return command


@dataclass(frozen=True)
class TargetCommand:
    """A world point for the end effector: either a box or, when ``radius`` is set, an upright
    cylinder's shell.

    Ranges are metres relative to the point under the robot's base at reset; z is above the ground.
    A share ``near`` of the targets is pulled towards that point by a uniform factor: practice in
    touching that does not begin with a walk.
    """

    z: Range
    x: Range = (0.0, 0.0)
    y: Range = (0.0, 0.0)
    radius: float | None = None
    near: float = 0.0

    def sample(self, origin: torch.Tensor, draw: torch.Generator) -> torch.Tensor:
        """(K, 3) world targets around ``origin`` (K, 3) [m]."""
        target = uniform((self.x, self.y, self.z), len(origin), draw)
        if self.radius is not None:
            angle = uniform(((-torch.pi, torch.pi),), len(origin), draw)[:, 0]
            target[:, 0], target[:, 1] = (
                self.radius * torch.cos(angle),
                self.radius * torch.sin(angle),
            )
        if self.near > 0.0:
            chance, factor = torch.rand(2, len(origin), 1, generator=draw, device=draw.device)
            target[:, :2] *= torch.where(chance < self.near, factor, 1.0)
        target[:, :2] += origin[:, :2]
        return target

    def observe(self, command: torch.Tensor, state: RobotState) -> torch.Tensor:
        """(N, 3) the target in the base frame (full orientation, as in the original) [m]."""
        return rotate_inverse(state.root_quat, command - state.root_pos)


def uniform(ranges: tuple[Range, ...], count: int, draw: torch.Generator) -> torch.Tensor:
    """(count, len(ranges)) float32 on the generator's device, column i uniform in ranges[i]."""
    low, high = _bounds(ranges, draw.device)
    return low + (high - low) * torch.rand(count, len(ranges), generator=draw, device=draw.device)


@lru_cache(maxsize=256)
def _bounds(ranges: tuple[Range, ...], device: torch.device) -> tuple[torch.Tensor, torch.Tensor]:
    """Lower and upper bounds; kept, because bringing them to a GPU makes the host wait."""
    low, high = torch.tensor(ranges, dtype=torch.float32, device=device).T
    return low, high
