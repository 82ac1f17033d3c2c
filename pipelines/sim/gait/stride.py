"""The gait that a commanded velocity asks for, as joint positions: feed-forward for a policy that
adds what keeps the robot up.

Played alone, an H1 falls after 1.2 s of it.
"""

from __future__ import annotations

import math

import torch

from lacoloco.pipelines.sim.gait.clock import GaitClock
from lacoloco.pipelines.sim.gait.leg_kinematics import find_legs
from lacoloco.robots.spec import RobotSpec


class StrideReference:
    """Joint positions of a walk on flat ground, from the clock and the command."""

    def __init__(self, spec: RobotSpec, device: torch.device) -> None:
        """Read the legs from the robot's model.

        Raises:
            RobotError: They cannot walk this way; one line that says what is missing.
        """
        self.legs = find_legs(spec)
        self.default = torch.tensor(spec.default_joint_pos, device=device)
        self.sides = torch.tensor([[leg.side for leg in self.legs]], device=device)
        self._ankles = [leg.ankle() for leg in self.legs]

    def __call__(self, clock: GaitClock, command: torch.Tensor) -> torch.Tensor:
        """(N, J) joint positions [rad] for a commanded velocity (N, 3) [m/s, m/s, rad/s].

        A foot on the ground goes back under the hip as fast as the ground does: the outer foot of a
        turn faster, and turning against it. In the air it goes forward again, up to ``gait.lift``
        high.
        """
        swing, period = clock.gait.swing_share, clock.gait.period
        local = clock.local()
        half_stance = 0.5 * (1.0 - swing) * period * clock.stepping[:, None]
        reach = (command[:, :1] - command[:, 2:] * self.sides) * half_stance
        twist = command[:, 2:] * half_stance
        along, in_air = _swung(local, swing)
        lift = clock.gait.lift * torch.sin(math.pi * in_air).square() * clock.stepping[:, None]
        pose = self.default.repeat(len(command), 1)
        for column, (leg, (forward, below)) in enumerate(zip(self.legs, self._ankles, strict=True)):
            x = forward + reach[:, column] * along[:, column]
            pose[:, list(leg.pitch)] = leg.solve(x, below - lift[:, column])
            if leg.yaw is not None:
                pose[:, leg.yaw] += leg.yaw_sign * (twist * along)[:, column]
        return pose


def _swung(local: torch.Tensor, swing: float) -> tuple[torch.Tensor, torch.Tensor]:
    """Where a foot is between -1 (farthest back) and 1, and how much of its time in the air has
    passed, both (N, 2).
    """
    air = (local / swing).clamp(max=1.0)
    ground = ((local - swing) / (1.0 - swing)).clamp(min=0.0)
    smooth = air.square() * (3.0 - 2.0 * air)
    along = torch.where(local < swing, 2.0 * smooth - 1.0, 1.0 - 2.0 * ground)
    return along, torch.where(local < swing, air, 0.0)
