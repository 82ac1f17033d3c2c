"""The physics engine without anything around it: what the speed of an environment is compared
with.
"""

from __future__ import annotations

from typing import Protocol

import torch
from mujoco.batch import Batch

from lacoloco.pipelines.sim.mujoco_cpu import BatchPhysics
from lacoloco.pipelines.sim.physics import SUBSTEPS, Physics


class BareEngine(Protocol):
    """An engine to be timed alone."""

    def load(self, targets: torch.Tensor) -> None:
        """Take over the present state of the physics, and joint targets (T, N, J) [rad]."""

    def run(self) -> None:
        """Hold every target for one control step. This is what is to be timed."""


def bare_engine(physics: Physics) -> BareEngine:
    """The engine of ``physics``: MuJoCo's native batch alone on the CPU, elsewhere ``physics``
    itself.
    """
    return BareBatch(physics) if isinstance(physics, BatchPhysics) else PhysicsAlone(physics)


class BareBatch:
    """The native batch on the same model and state: shared parameters, no sensor read, no tensor
    made.
    """

    def __init__(self, physics: BatchPhysics) -> None:
        """Allocate as many worlds."""
        self._physics = physics
        self.batch = Batch(physics.model, physics.num_worlds)
        self._ctrl = self.batch.bind("ctrl")

    def load(self, targets: torch.Tensor) -> None:
        """See :class:`BareEngine`."""
        self.batch.state[:] = self._physics.state_dict()["rows"].numpy()
        self._rows = targets.double().numpy()

    def run(self) -> None:
        """See :class:`BareEngine`."""
        for row in self._rows:
            self._ctrl[:] = row
            self.batch.step(nstep=SUBSTEPS)


class PhysicsAlone:
    """The physics without an environment; it is put back where it was."""

    def __init__(self, physics: Physics) -> None:
        """Take the physics to time."""
        self._physics = physics

    def load(self, targets: torch.Tensor) -> None:
        """See :class:`BareEngine`."""
        self._targets = targets

    def run(self) -> None:
        """See :class:`BareEngine`."""
        state = self._physics.state_dict()
        for row in self._targets:
            self._physics.step(row)
        self._physics.load_state_dict(state)
