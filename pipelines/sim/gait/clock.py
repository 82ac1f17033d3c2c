"""A gait clock: which foot should swing now, and when a standing robot has to step.

A robot on two small feet does not stand passively. So the clock goes on for a cycle after a stop,
until the feet are side by side, and starts again when the robot drifts or tilts.
"""

from __future__ import annotations

import math

import torch

from lacoloco.pipelines.masking import put
from lacoloco.pipelines.sim.physics import CONTROL_DT
from lacoloco.robots.numbers import Gait

ASKED_SPEED = 0.1
"""Norm of a commanded velocity from which it asks for steps (the original's code)."""
MEMORY = 3
"""Numbers that say where a clock stands; see :meth:`GaitClock.memory`."""
MEMORY_UNIT = 0.5
"""What one unit of action stands for. With 0.2, so that exploration moves a phase less, errors of
the clock made up most of the loss of cloning, and those of joints grew.
"""
REMEMBERED_CYCLES = 1.2
"""Cycles without a command that are told apart: after one the clock may stop, and a network that is
a little off must still say so.
"""


class GaitClock:
    """Phases of N worlds in [0, 1): the left foot swings from 0 on, the right one from 1/2 on.

    Attributes:
        phase: (N,) share of the cycle that has passed.
        stepping: (N,) bool, False where the clock stands still and both feet stay on the ground.
    """

    def __init__(self, gait: Gait, num_worlds: int, device: torch.device) -> None:
        """Start with every clock at rest."""
        self.gait = gait
        self.phase = torch.zeros(num_worlds, device=device)
        self.stepping = torch.zeros(num_worlds, dtype=torch.bool, device=device)
        self._idle = torch.zeros(num_worlds, device=device)

    def advance(
        self, asked: torch.Tensor, speed: torch.Tensor, tilt: torch.Tensor, force: torch.Tensor
    ) -> None:
        """One control step.

        Args:
            asked: (N,) bool, a velocity is commanded.
            speed: (N,) planar speed of the base [m/s].
            tilt: (N,) length of the horizontal part of the projected gravity.
            force: (N, 2) contact force on the left and on the right foot [N].
        """
        gait = self.gait
        self._idle = torch.where(asked, 0.0, self._idle + CONTROL_DT)
        closed = (self.phase % 0.5 >= gait.swing_share) & (self._idle > gait.period)
        stops = closed & (speed < gait.stop_speed) & (tilt < gait.stop_tilt)
        starts = ~self.stepping & (asked | (speed > gait.start_speed) | (tilt > gait.start_tilt))
        self.stepping = (self.stepping & ~stops) | starts
        # A walk always starts with the same foot: who imitates both ways starts with neither. A
        # step that keeps the robot up is made by the foot that carries less.
        second = ~asked & (force[:, 0] > force[:, 1])
        first = gait.swing_share + torch.where(second, 0.0, 0.5)
        phase = torch.where(starts, first, self.phase)
        moved = (phase + CONTROL_DT / gait.period) % 1.0
        self.phase = torch.where(self.stepping, moved, phase)

    def memory(self) -> torch.Tensor:
        """(N, MEMORY) all that the next step depends on, as a network can say it: sine and cosine
        of the phase within the whole cycle, zeros where it rests; for how many cycles no velocity
        was commanded, up to :data:`REMEMBERED_CYCLES`. In units of :data:`MEMORY_UNIT`.
        """
        angle = 2.0 * math.pi * self.phase
        shown = torch.stack((torch.sin(angle), torch.cos(angle)), dim=1) * self.stepping[:, None]
        idle = (self._idle / self.gait.period).clamp(max=REMEMBERED_CYCLES)
        return torch.cat((shown, idle[:, None]), dim=1) / MEMORY_UNIT

    def recall(self, memory: torch.Tensor, mask: torch.Tensor) -> None:
        """Set the clocks of ``mask`` (N,) bool to what ``memory`` (N, MEMORY) says."""
        sine, cosine, idle = (MEMORY_UNIT * memory).unbind(dim=1)
        phase = (torch.atan2(sine, cosine) / (2.0 * math.pi)) % 1.0
        stepping = torch.hypot(sine, cosine) > 0.5
        self.phase = torch.where(mask & stepping, phase, self.phase)
        self.stepping = torch.where(mask, stepping, self.stepping)
        self._idle = torch.where(mask, self.gait.period * idle.clamp(min=0.0), self._idle)

    def reset(self, worlds: torch.Tensor, phase: torch.Tensor, stepping: torch.Tensor) -> None:
        """Set the clocks of ``worlds``: rows (K,) of phases and of whether they run."""
        for name, values in (("phase", phase), ("stepping", stepping), ("_idle", 0.0)):
            kept = getattr(self, name).clone()
            put(kept, worlds, values)
            setattr(self, name, kept)

    def local(self) -> torch.Tensor:
        """(N, 2) phase of the left and of the right foot, each swinging from 0 on."""
        return torch.stack((self.phase, (self.phase - 0.5) % 1.0), dim=1)

    def swings(self) -> torch.Tensor:
        """(N, 2) bool: the left, the right foot should be in the air."""
        return (self.local() < self.gait.swing_share) & self.stepping[:, None]

    def second_half(self) -> torch.Tensor:
        """(N,) bool: the right foot's half of the cycle."""
        return (self.phase >= 0.5) & self.stepping

    def observe(self) -> torch.Tensor:
        """(N, 3) sine and cosine of the phase within a half cycle, and 1; zeros where it rests.

        Both halves look alike, since the second one is seen in the mirror.
        """
        angle = 4.0 * math.pi * (self.phase % 0.5)
        shown = torch.stack((torch.sin(angle), torch.cos(angle), torch.ones_like(angle)), dim=1)
        return shown * self.stepping[:, None]

    def state_dict(self) -> dict[str, torch.Tensor]:
        """Everything that makes the next step what it is."""
        return {"phase": self.phase, "stepping": self.stepping, "idle": self._idle}

    def load_state_dict(self, state: dict[str, torch.Tensor]) -> None:
        """Restore :meth:`state_dict`."""
        device = self.phase.device
        self.phase, self.stepping = state["phase"].to(device), state["stepping"].to(device)
        self._idle = state["idle"].to(device)
