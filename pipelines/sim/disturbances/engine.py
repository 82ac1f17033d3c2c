"""MuJoCo's native batch with disturbances: one call per physics step, so that motors can react."""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import mujoco
import numpy as np
import torch

from lacoloco.pipelines.sim.disturbances.motors import Motors
from lacoloco.pipelines.sim.disturbances.scene import change_scene, without_gains
from lacoloco.pipelines.sim.disturbances.worlds import WorldChanges
from lacoloco.pipelines.sim.mujoco_cpu import BatchPhysics, numbered
from lacoloco.pipelines.sim.physics import CONTROL_DT, PHYSICS_DT, PhysicsRequest, WorldParameters
from lacoloco.robots.scene import compile_scene, contact_time


class DisturbedBatch(BatchPhysics):
    """:class:`~lacoloco.pipelines.sim.physics.Physics` whose motors, loads and floors are not those
    of the model; without disturbances it is :class:`BatchPhysics` bit for bit.

    Attributes:
        down: (N, 3) direction of gravity, world.
        joint_offset: (N, J) errors of the encoders [rad].
        trace: (N, S, 13 + 2J) qpos and qvel after each physics step of the last control step.
    """

    def __init__(self, request: PhysicsRequest) -> None:
        """Compile the disturbed robot and allocate the worlds."""
        self._request = request
        self._motors: Motors | None = None
        super().__init__(request)
        config, spec = request.disturbances, request.spec
        self._motors = Motors(config, spec, self.model, self.num_worlds, request.seed)
        self._changes = WorldChanges(config, self.num_worlds, len(spec.feet), request.seed)
        self._motors.install(self._batch, spec)
        self._mass = spec.total_mass()
        self.down = self._changes.down
        self.joint_offset = torch.from_numpy(self._motors.offset).float()
        qpos, qvel = self._default_state()
        self.reset(torch.arange(self.num_worlds), qpos, qvel)

    def _compile(self, request: PhysicsRequest) -> mujoco.MjModel:
        config = request.disturbances
        self.substeps = config.substeps
        self.timestep = CONTROL_DT / config.substeps
        # A finer step alone does not make contacts stiffer: that would be a second change.
        self.contact_time = config.contact_time or contact_time(PHYSICS_DT)
        contacts = replace(config, contact_time=self.contact_time)
        change = partial(change_scene, robot=request.spec, config=contacts)
        model = compile_scene(
            request.spec,
            timestep=self.timestep,
            training_limits=request.training_limits,
            change=change,
        )
        if config.explicit_pd:
            without_gains(model)
        return model

    def step(self, targets: torch.Tensor) -> None:
        """Hold joint targets (N, J) [rad] for one control step; see the contract."""
        motors = self._motors
        if motors is None:  # the first step, in which the batch allocates its record
            super().step(targets)
            return
        motors.command(targets.double().numpy())
        due = self._time + CONTROL_DT
        one: dict[str, np.ndarray] | None = None
        sensors, trace = [], []
        for _ in range(self.substeps):
            speeds = self._qvel[:, 6:]
            motors.limit_torque(self._batch, speeds)
            self._ctrl[:] = motors.control(self._qpos[:, 7:], speeds)
            one = self._batch.rollout(1, record=("sensordata", "actuator_force"), out=one)
            sensors.append(one["sensordata"][:, 0].copy())
            trace.append(np.concatenate((self._qpos, self._qvel), axis=1))
        assert one is not None
        self.trace = torch.from_numpy(np.stack(trace, axis=1)).float()
        self._take(np.stack(sensors, axis=1), one["actuator_force"][:, -1], due)

    def reset(self, worlds: torch.Tensor, qpos: torch.Tensor, qvel: torch.Tensor) -> None:
        """Put ``worlds`` into the given states; see the contract."""
        super().reset(worlds, qpos, qvel)
        if self._motors is not None:
            ids, pose = numbered(worlds, qpos)
            self._motors.restart(ids.numpy(), pose[:, 7:].double().numpy())

    def set_parameters(self, parameters: WorldParameters) -> None:
        """Give every world its own parameters, and its load, foot and slope."""
        super().set_parameters(self._changes.with_slippery_foot(parameters))
        self._changes.install(self._batch, self.model, self._base, self._mass)

    def state_dict(self) -> dict[str, torch.Tensor]:
        """Everything the engine needs to go on bit for bit, targets on their way included."""
        assert self._motors is not None
        return {**super().state_dict(), **self._motors.state_dict()}

    def load_state_dict(self, state: dict[str, torch.Tensor]) -> None:
        """Restore :meth:`state_dict`."""
        assert self._motors is not None
        super().load_state_dict(state)
        self._motors.load_state_dict(state)
