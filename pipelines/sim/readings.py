"""What the sensors of robots gave in the last control steps.

Sensors are read once in a control step: two looks at one reading show the same noise, and an older
reading keeps the noise that it had. Where an episode begins, all readings are that of its first
moment, as of a robot that has stood there.
"""

from __future__ import annotations

from typing import Any

import torch

from lacoloco.pipelines.masking import pick, put
from lacoloco.pipelines.sim.odometry import Odometry
from lacoloco.pipelines.sim.state import RobotState
from lacoloco.robots.numbers import OdometryDrift


class Record:
    """The last H readings of N worlds, newest first.

    Attributes:
        rows: (N, H, W).
    """

    def __init__(self, reading: torch.Tensor, history: int) -> None:
        """Begin with readings (N, W)."""
        self.rows = reading[:, None].repeat(1, history, 1)

    def push(self, reading: torch.Tensor) -> None:
        """Take in the next readings (N, W)."""
        self.rows = torch.cat((reading[:, None], self.rows[:, :-1]), dim=1)

    def restart(self, worlds: torch.Tensor, reading: torch.Tensor) -> None:
        """Forget what was before readings (N, W) in ``worlds``, numbers (K,) or a mask (N,)."""
        self.rows = self.rows.clone()
        fresh = pick(reading, worlds)[:, None]
        put(self.rows, worlds, fresh.expand(-1, self.rows.shape[1], -1))

    def extend(self, history: int) -> None:
        """Keep at least so many readings."""
        missing = history - self.rows.shape[1]
        if missing > 0:
            self.rows = torch.cat((self.rows, self.rows[:, -1:].repeat(1, missing, 1)), dim=1)

    def latest(self, history: int) -> torch.Tensor:
        """(N, history W) the newest readings, one behind the other."""
        return self.rows[:, :history].flatten(1)


class Readings:
    """A record of the readings and an odometry, for the worlds of an environment."""

    def __init__(
        self, reading: torch.Tensor, seen: RobotState, drift: OdometryDrift, seed: int
    ) -> None:
        """Begin with readings (N, W) in the states ``seen``."""
        self.record = Record(reading, 1)
        self.odometry = Odometry(drift, seen, seed)

    def advance(self, reading: torch.Tensor, seen: RobotState) -> None:
        """Take in readings (N, W) after a control step that ended in ``seen``."""
        self.record.push(reading)
        self.odometry.advance(seen)

    def restart(self, worlds: torch.Tensor, reading: torch.Tensor, seen: RobotState) -> None:
        """Begin anew in ``worlds``, with readings (N, W) in the states ``seen``."""
        self.record.restart(worlds, reading)
        self.odometry.restart(worlds, seen)

    def state_dict(self) -> dict[str, Any]:
        """Everything that makes the next step what it is."""
        return {"rows": self.record.rows, "odometry": self.odometry.state_dict()}

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Restore :meth:`state_dict`."""
        self.record.rows = state["rows"].to(self.record.rows.device)
        self.odometry.load_state_dict(state["odometry"])
