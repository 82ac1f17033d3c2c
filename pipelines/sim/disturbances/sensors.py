"""Sensors as they are: late, noisy, off, filtered, and blind now and then.

The base's position and linear velocity come from motion capture, its orientation and turning from
an IMU, joints from encoders.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Protocol

import torch

from lacoloco.datasets.rotations import rotate_inverse
from lacoloco.pipelines.masking import pick, put
from lacoloco.pipelines.sim.disturbances.config import Disturbances
from lacoloco.pipelines.sim.disturbances.randomness import grades, own_generator, rounded, spread
from lacoloco.pipelines.sim.physics import CONTROL_DT
from lacoloco.pipelines.sim.state import RobotState


class Traced(Protocol):
    """Physics that keeps every physics step; see
    :class:`lacoloco.pipelines.sim.disturbances.engine.DisturbedBatch`.
    """

    qpos: torch.Tensor
    qvel: torch.Tensor
    trace: torch.Tensor
    down: torch.Tensor
    joint_offset: torch.Tensor
    substeps: int


@dataclass
class Reading(RobotState):
    """What sensors say of the state; ``down`` (N, 3) is where an accelerometer finds gravity."""

    down: torch.Tensor

    @property
    def gravity_b(self) -> torch.Tensor:
        """(N, 3) unit direction of gravity in the base frame."""
        return rotate_inverse(self.root_quat, self.down)


class Sensors:
    """The sensors of N worlds. Readings change once in a control step, noise with every look."""

    def __init__(
        self, config: Disturbances, physics: object, noise_scale: torch.Tensor, seed: int
    ) -> None:
        """Begin with the present state.

        Args:
            config: What is wrong with them.
            physics: A :class:`Traced` one, unless they only have noise.
            noise_scale: (width,) half-ranges of the noise on an observation.
            seed: Of the environment.
        """
        self._config, self._scale = config, config.noise * noise_scale
        self._generator = own_generator(seed, 3)
        self._traced: Traced | None = None
        if not config.of_readings:
            return
        traced: Traced = physics  # type: ignore[assignment]
        self._traced, self._dt = traced, CONTROL_DT / traced.substeps
        longest = config.observation_latency * (1.0 + config.latency_jitter)
        self._kept = 2 + math.ceil((longest + config.mocap_delay[1]) / self._dt)
        self._joints = traced.qpos.shape[1] - 7
        now = torch.cat((traced.qpos, traced.qvel), dim=1)
        self._history = now[:, None].repeat(1, self._kept, 1)
        self._captured = self._motion_capture(now)
        self._latency = config.observation_latency * grades(
            config.graded, len(now), self._generator
        )
        self._blind = torch.zeros(len(now), dtype=torch.long)
        self._joints_and_base = now
        self._assemble()

    def restart(self, worlds: torch.Tensor) -> None:
        """Forget what was before in ``worlds``, numbers (K,) or a mask (N,)."""
        if self._traced is None:
            return
        now = torch.cat((self._traced.qpos, self._traced.qvel), dim=1)
        put(self._history, worlds, pick(now, worlds)[:, None].expand(-1, self._kept, -1))
        self._captured = self._captured.clone()
        put(self._captured, worlds, self._motion_capture(pick(now, worlds)))
        put(self._blind, worlds, 0)
        self._joints_and_base = self._joints_and_base.clone()
        put(self._joints_and_base, worlds, pick(now, worlds))
        self._assemble()

    def update(self) -> None:
        """Take over the control step that the physics has just made."""
        if self._traced is None:
            return
        config, worlds = self._config, len(self._history)
        trace = self._traced.trace
        self._history = torch.cat((self._history, trace), dim=1)[:, -self._kept :]
        jitter = spread(config.latency_jitter, (worlds,), self._generator)
        delay = self._latency * (1.0 + jitter)
        low, high = config.mocap_delay
        further = low + (high - low) * torch.rand(worlds, generator=self._generator)
        seen = self._motion_capture(self._past(delay + further))
        lost = self._lose(worlds)
        share = 1.0 if not config.mocap_filter else -math.expm1(-CONTROL_DT / config.mocap_filter)
        filtered = self._captured + share * (seen - self._captured)
        self._captured = torch.where(lost[:, None], self._captured, filtered)
        self._joints_and_base = self._past(delay)
        self._assemble()

    def reading(self, state: RobotState) -> RobotState:
        """What the sensors say; the state itself where they only have noise."""
        return state if self._traced is None else self._reading

    def reading_on_board(self, state: RobotState) -> RobotState:
        """The same with a position that comes from IMU and joints, as late as they are, and not
        from motion capture.
        """
        if self._traced is None:
            return state
        return replace(self._reading, root_pos=self._joints_and_base[:, :3])

    def look(self, observation: torch.Tensor) -> torch.Tensor:
        """An observation (N, width) with noise."""
        if self._config.noise == 0.0:
            return observation
        noise = spread(1.0, tuple(observation.shape), self._generator).to(observation.device)
        return observation + noise * self._scale

    def state_dict(self) -> dict[str, torch.Tensor]:
        """What is remembered, and the generator."""
        state = {"generator": self._generator.get_state()}
        if self._traced is not None:
            seen = (self._captured, self._blind, self._joints_and_base)
            state |= dict(zip(("captured", "blind", "seen"), seen, strict=True))
            state["history"] = self._history
        return state

    def load_state_dict(self, state: dict[str, torch.Tensor]) -> None:
        """Restore :meth:`state_dict`."""
        self._generator.set_state(state["generator"])
        if self._traced is not None:
            self._captured, self._blind = state["captured"].clone(), state["blind"].clone()
            self._history = state["history"].clone()
            self._joints_and_base = state["seen"].clone()
            self._assemble()

    def _past(self, delay: torch.Tensor) -> torch.Tensor:
        """(N, 13 + 2J) coordinates ``delay`` (N,) [s] ago, between two physics steps in a line."""
        place = (self._kept - 1 - delay / self._dt).clamp(0.0, self._kept - 1.0)
        before = place.floor().long()
        after = (before + 1).clamp(max=self._kept - 1)
        rows, part = torch.arange(len(place)), (place - before)[:, None]
        mixed = (1.0 - part) * self._history[rows, before] + part * self._history[rows, after]
        quat = mixed[:, 3:7]
        mixed[:, 3:7] = quat / quat.norm(dim=1, keepdim=True)
        return mixed

    def _motion_capture(self, rows: torch.Tensor) -> torch.Tensor:
        """(K, 6) position [m] and linear velocity [m/s] of the base, world."""
        first = 7 + self._joints
        return torch.cat((rows[:, :3], rows[:, first : first + 3]), dim=1)

    def _lose(self, worlds: int) -> torch.Tensor:
        """(N,) bool, worlds that the motion capture does not see in this control step."""
        config = self._config
        if config.mocap_dropout == 0.0:
            return torch.zeros(worlds, dtype=torch.bool)
        chance = CONTROL_DT / max(config.mocap_dropout_interval, CONTROL_DT)
        lost = torch.rand(worlds, generator=self._generator) < chance
        length = rounded(torch.full((worlds,), config.mocap_dropout / CONTROL_DT), self._generator)
        self._blind = torch.where(lost & (self._blind == 0), length, self._blind)
        blind = self._blind > 0
        self._blind = (self._blind - 1).clamp(min=0)
        return blind

    def _assemble(self) -> None:
        assert self._traced is not None
        rows, joints = self._joints_and_base, self._joints
        quat = rows[:, 3:7]
        self._reading = Reading(
            self._captured[:, :3],
            quat,
            rotate_inverse(quat, self._captured[:, 3:]),
            rows[:, 10 + joints : 13 + joints],
            rows[:, 7 : 7 + joints] + self._traced.joint_offset,
            rows[:, 13 + joints :],
            self._traced.down,
        )


def make_sensors(
    config: Disturbances, physics: object, noise_scale: torch.Tensor, seed: int
) -> Sensors | None:
    """The disturbed sensors; None where a policy sees the state itself."""
    return Sensors(config, physics, noise_scale, seed) if config.of_sensors else None
