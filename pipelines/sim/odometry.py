"""Where robots believe to be that count their way: a dead reckoning that drifts.

It is no estimator. The true motion of the base is summed up with errors that an estimator from legs
and IMU has: of a way its share is wrong, forward, sideways and up, and the heading turns away.
Roll and pitch stay true, because gravity shows them.
"""

from __future__ import annotations

from dataclasses import replace

import torch

from lacoloco.datasets.rotations import from_yaw, multiply, rotate, rotate_inverse, yaw
from lacoloco.pipelines.masking import pick, put
from lacoloco.pipelines.sim.physics import CONTROL_DT
from lacoloco.pipelines.sim.state import RobotState
from lacoloco.robots.numbers import OdometryDrift


class Odometry:
    """The odometry of N robots. It is right where an episode begins.

    Attributes:
        offset: (N, 3) believed position less the true one, world [m].
        turn: (N,) believed heading less the true one [rad].
    """

    def __init__(self, drift: OdometryDrift, state: RobotState, seed: int) -> None:
        """Begin at ``state``. Errors have a generator of their own, so that the episodes of a seed
        are the same with and without an odometry.
        """
        device = state.root_pos.device
        self._drift = drift
        self._generator = torch.Generator(device).manual_seed(seed)
        self.offset = torch.zeros_like(state.root_pos)
        self.turn = torch.zeros_like(self.offset[:, 0])
        self._scale, self._rate = torch.zeros_like(self.offset), torch.zeros_like(self.turn)
        self._last = state.root_pos.clone()
        self.restart(torch.ones_like(self.turn, dtype=torch.bool), state)

    def restart(self, worlds: torch.Tensor, state: RobotState) -> None:
        """Begin anew in ``worlds``, numbers (K,) or a mask (N,), with other errors."""
        errors = 2.0 * self._random(len(worlds), 4) - 1.0
        for name, value in (
            ("offset", 0.0),
            ("turn", 0.0),
            ("_scale", self._drift.distance * errors[:, :3]),
            ("_rate", self._drift.heading * errors[:, 3]),
            ("_last", pick(state.root_pos, worlds)),
        ):
            kept = getattr(self, name).clone()
            put(kept, worlds, value)
            setattr(self, name, kept)

    def advance(self, state: RobotState) -> None:
        """Count the control step that ended in ``state``."""
        moved = state.root_pos - self._last
        heading = yaw(state.root_quat)
        believed = (1.0 + self._scale) * rotate_inverse(from_yaw(heading), moved)
        believed = rotate(from_yaw(heading + self.turn), believed)
        self.offset = self.offset + believed - moved
        self.turn = self.turn + self._rate * CONTROL_DT
        self._last = state.root_pos

    def reading(self, state: RobotState) -> RobotState:
        """``state`` with the believed position and heading."""
        return replace(
            state,
            root_pos=state.root_pos + self.offset,
            root_quat=multiply(from_yaw(self.turn), state.root_quat),
        )

    def state_dict(self) -> dict[str, torch.Tensor]:
        """Everything that makes the next step what it is."""
        kept = {name: getattr(self, name) for name in _STATE}
        return {"generator": self._generator.get_state(), **kept}

    def load_state_dict(self, state: dict[str, torch.Tensor]) -> None:
        """Restore :meth:`state_dict`."""
        self._generator.set_state(state["generator"])
        for name in _STATE:
            setattr(self, name, state[name].to(self.offset.device))

    def _random(self, *shape: int) -> torch.Tensor:
        return torch.rand(shape, generator=self._generator, device=self._generator.device)


_STATE = ("offset", "turn", "_scale", "_rate", "_last")
