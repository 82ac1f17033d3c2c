"""What a task asks of the robot: a velocity to track, a heading or a height to hold, a point to
touch.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import ClassVar, Protocol

import torch

from lacoloco.datasets.rotations import from_yaw, rotate, rotate_inverse, yaw
from lacoloco.pipelines.sim.state import RobotState, Term
from lacoloco.robots.tables import Angle, Length, Range, Share


class Command(Protocol):
    """A kind of command: three numbers per world, drawn at resets; the policy sees what ``term``
    says.

    Attributes:
        term: What a policy observes of it.
    """

    term: ClassVar[Term]

    def sample(self, origin: torch.Tensor, generator: torch.Generator) -> torch.Tensor:
        """(K, 3) new commands for K worlds around ``origin`` (K, 3) [m]."""
        ...

    def observe(self, command: torch.Tensor, state: RobotState) -> torch.Tensor:
        """(N, term.size) what the policy sees of ``command`` (N, 3)."""
        ...

    def carried(
        self, command: torch.Tensor, pose: torch.Tensor, other: torch.Tensor
    ) -> torch.Tensor:
        """(N, 3) what asks of robots at ``other`` (N, 7) what ``command`` (N, 3) asks at ``pose``
        (N, 7): positions [m] and orientations (w, x, y, z) in the world; heights stay.
        """
        ...


@dataclass(frozen=True)
class VelocityCommand:
    """Planar velocity in the base's heading: uniform ranges [m/s, m/s, rad/s]; a share of worlds is
    told to stand.
    """

    term: ClassVar[Term] = Term("velocity_command", 3, "m/s, rad/s", "base")

    forward: Range
    lateral: Range
    yaw_rate: Range
    standing: Share = 0.02

    def sample(self, origin: torch.Tensor, generator: torch.Generator) -> torch.Tensor:
        """(K, 3) new commands for K worlds; ``origin`` (K, 3) only gives the count."""
        command = uniform((self.forward, self.lateral, self.yaw_rate), len(origin), generator)
        moving = (
            torch.rand(len(origin), generator=generator, device=generator.device) >= self.standing
        )
        return command * moving[:, None]

    def observe(self, command: torch.Tensor, state: RobotState) -> torch.Tensor:
        """(N, 3) the command itself: it is already relative to the base."""
        return command

    def carried(
        self, command: torch.Tensor, pose: torch.Tensor, other: torch.Tensor
    ) -> torch.Tensor:
        """(N, 3) the command itself."""
        return command


@dataclass(frozen=True)
class TargetCommand:
    """A world point for the end effector: either a box or, when ``radius`` is set, an upright
    cylinder's shell.

    Ranges are metres relative to the point under the robot's base at reset; z is above the ground.
    A share ``near`` of the targets is pulled towards that point by a uniform factor: practice in
    touching that does not begin with a walk.
    """

    term: ClassVar[Term] = Term("target", 3, "m", "base")

    z: Range
    x: Range = (0.0, 0.0)
    y: Range = (0.0, 0.0)
    radius: Length | None = None
    near: Share = 0.0

    def sample(self, origin: torch.Tensor, generator: torch.Generator) -> torch.Tensor:
        """(K, 3) world targets around ``origin`` (K, 3) [m]."""
        target = uniform((self.x, self.y, self.z), len(origin), generator)
        if self.radius is not None:
            angle = uniform(((-torch.pi, torch.pi),), len(origin), generator)[:, 0]
            target[:, 0], target[:, 1] = (
                self.radius * torch.cos(angle),
                self.radius * torch.sin(angle),
            )
        if self.near > 0.0:
            chance, factor = torch.rand(
                2, len(origin), 1, generator=generator, device=generator.device
            )
            target[:, :2] *= torch.where(chance < self.near, factor, 1.0)
        target[:, :2] += origin[:, :2]
        return target

    def farthest(self) -> float:
        """Largest horizontal distance of a target from where the robot begins [m]."""
        if self.radius is not None:
            return self.radius
        return math.hypot(max(map(abs, self.x)), max(map(abs, self.y)))

    def observe(self, command: torch.Tensor, state: RobotState) -> torch.Tensor:
        """(N, 3) the target in the base frame (full orientation, as in the original) [m]."""
        return rotate_inverse(state.root_quat, command - state.root_pos)

    def carried(
        self, command: torch.Tensor, pose: torch.Tensor, other: torch.Tensor
    ) -> torch.Tensor:
        """(N, 3) targets as far ahead and as far to the side [m]."""
        offset = rotate(_turn(pose, other), command - pose[:, :3])
        placed = other[:, :3] + offset
        return torch.cat((placed[:, :2], command[:, 2:]), dim=1)


@dataclass(frozen=True)
class HeadingCommand:
    """A heading to turn to and hold: its angle in the world, uniform up to ``max_angle`` to either
    side [rad].
    """

    term: ClassVar[Term] = Term("heading_command", 3, "1", "base")

    max_angle: Angle = torch.pi

    def sample(self, origin: torch.Tensor, generator: torch.Generator) -> torch.Tensor:
        """(K, 3) unit vectors in the world; ``origin`` (K, 3) only gives the count."""
        angle = uniform(((-self.max_angle, self.max_angle),), len(origin), generator)[:, 0]
        return torch.stack((torch.cos(angle), torch.sin(angle), torch.zeros_like(angle)), dim=-1)

    def observe(self, command: torch.Tensor, state: RobotState) -> torch.Tensor:
        """(N, 3) the unit vector in the base frame."""
        return rotate_inverse(state.root_quat, command)

    def carried(
        self, command: torch.Tensor, pose: torch.Tensor, other: torch.Tensor
    ) -> torch.Tensor:
        """(N, 3) unit vectors as far to the side of the heading."""
        return rotate(_turn(pose, other), command)


@dataclass(frozen=True)
class HeightCommand:
    """A height above the ground at which to hold the end effector, uniform in ``height`` [m]."""

    term: ClassVar[Term] = Term("height_command", 1, "m", "world")

    height: Range

    def sample(self, origin: torch.Tensor, generator: torch.Generator) -> torch.Tensor:
        """(K, 3) points of which only z is asked for; ``origin`` (K, 3) only gives the count."""
        return uniform(((0.0, 0.0), (0.0, 0.0), self.height), len(origin), generator)

    def observe(self, command: torch.Tensor, state: RobotState) -> torch.Tensor:
        """(N, 1) the height itself."""
        return command[:, 2:]

    def carried(
        self, command: torch.Tensor, pose: torch.Tensor, other: torch.Tensor
    ) -> torch.Tensor:
        """(N, 3) the command itself."""
        return command


def _turn(pose: torch.Tensor, other: torch.Tensor) -> torch.Tensor:
    """(N, 4) rotation about the vertical from the heading of one pose (N, 7) to that of another."""
    angle: torch.Tensor = yaw(other[:, 3:7]) - yaw(pose[:, 3:7])
    turn: torch.Tensor = from_yaw(angle)
    return turn


def heading_error(command: torch.Tensor, state: RobotState) -> torch.Tensor:
    """(N,) angle between the base's forward axis on the ground and ``command`` (N, 3) [rad]."""
    ahead = torch.zeros_like(state.root_pos)
    ahead[:, 0] = 1.0
    ahead = rotate(state.root_quat, ahead)
    across = ahead[:, 0] * command[:, 1] - ahead[:, 1] * command[:, 0]
    along = ahead[:, 0] * command[:, 0] + ahead[:, 1] * command[:, 1]
    return torch.atan2(across, along).abs()


COMMANDS: dict[str, type] = {
    "velocity": VelocityCommand,
    "target": TargetCommand,
    "heading": HeadingCommand,
    "height": HeightCommand,
}


def uniform(ranges: tuple[Range, ...], count: int, generator: torch.Generator) -> torch.Tensor:
    """(count, len(ranges)) float32 on the generator's device, column i uniform in ranges[i]."""
    low, high = _bounds(ranges, generator.device)
    return low + (high - low) * torch.rand(
        count, len(ranges), generator=generator, device=generator.device
    )


@lru_cache(maxsize=256)
def _bounds(ranges: tuple[Range, ...], device: torch.device) -> tuple[torch.Tensor, torch.Tensor]:
    """Lower and upper bounds; kept, because bringing them to a GPU makes the host wait."""
    low, high = torch.tensor(ranges, dtype=torch.float32, device=device).T
    return low, high
