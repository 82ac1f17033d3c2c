"""The CPU engine: MuJoCo 4's native multithreaded batch (bit-reproducible at any number of
threads).
"""

from __future__ import annotations

import os

import mujoco
import numpy as np
import torch
from mujoco.batch import Batch

from lacoloco.pipelines.sim.physics import (
    CONTROL_DT,
    PHYSICS_DT,
    SUBSTEPS,
    PhysicsRequest,
    WorldParameters,
    monitored_bodies,
)
from lacoloco.robots.geometry import foot_geoms
from lacoloco.robots.scene import compile_scene, contact_time


class BatchPhysics:
    """:class:`~lacoloco.pipelines.sim.physics.Physics` on ``mujoco.batch.Batch``.

    Only generalised coordinates and sensors are read, and both are current after a step without a
    further forward pass: kinematics and collision run four times per control step, not five.
    """

    def __init__(self, request: PhysicsRequest) -> None:
        """Compile the robot and allocate the worlds, all in the model's default state."""
        spec, self.num_worlds = request.spec, request.num_worlds
        self.device = torch.device("cpu")
        self.substeps, self.timestep = SUBSTEPS, PHYSICS_DT
        self.contact_time = contact_time(PHYSICS_DT)
        self.model = self._compile(request)
        self.monitored = monitored_bodies(spec)
        self._batch = Batch(self.model, self.num_worlds, nthread=request.threads or _own_threads())
        self._qpos, self._qvel, self._ctrl = (
            self._batch.bind(name) for name in ("qpos", "qvel", "ctrl")
        )
        self._time = self._batch.bind("time")
        self._feet = np.stack([_columns(self.model, f"force_{body}") for body in spec.feet])
        self._bodies = np.stack([_columns(self.model, f"force_{body}") for body in self.monitored])
        self._foot_geoms, self._foot_of_geom = foot_geoms(self.model, spec.feet)
        self._base = int(self.model.jnt_bodyid[0])
        self._record: dict[str, np.ndarray] | None = None
        self.step(torch.zeros(self.num_worlds, self.model.nu))
        self.reset(torch.arange(self.num_worlds), *self._default_state())

    def _compile(self, request: PhysicsRequest) -> mujoco.MjModel:
        return compile_scene(
            request.spec, timestep=self.timestep, training_limits=request.training_limits
        )

    def step(self, targets: torch.Tensor) -> None:
        """Hold joint targets (N, J) [rad] for one control step; see the contract."""
        self._ctrl[:] = targets.numpy()
        due = self._time + CONTROL_DT
        # A dict of (N, S, ...) arrays, one row per substep, written in place from the second call
        # on.
        self._record = self._batch.rollout(
            self.substeps, record=("sensordata", "actuator_force"), out=self._record
        )
        torques = self._record["actuator_force"][:, -1]
        self._take(self._record["sensordata"], torques, due)

    def _take(self, sensors: np.ndarray, torques: np.ndarray, due: np.ndarray) -> None:
        """Refresh every attribute from the sensors (N, S, ...) of a control step, its last torques
        (N, J), and the clocks (N,) that it should have ended with.
        """
        self.foot_force = torch.from_numpy(_norms(sensors, self._feet)).float()
        self.body_force = torch.from_numpy(_norms(sensors, self._bodies).max(axis=1)).float()
        self.torque = torch.from_numpy(torques).float()
        # A world that MuJoCo resets starts its clock again from zero, and one that warns of
        # anything, also of a target that is not a number, stops. The counters of warnings do not
        # tell: they are reset with their world.
        self.diverged = torch.from_numpy(np.abs(self._time - due) > 0.5 * self.timestep)
        self._refresh()

    def reset(self, worlds: torch.Tensor, qpos: torch.Tensor, qvel: torch.Tensor) -> None:
        """Put ``worlds`` into the given states; see the contract."""
        worlds, qpos, qvel = numbered(worlds, qpos, qvel)
        rows = worlds.numpy()
        if not len(rows):
            return
        self._batch.reset(rows, stage=int(mujoco.mjtStage.mjSTAGE_NONE))
        self._qpos[rows], self._qvel[rows] = qpos.numpy(), qvel.numpy()
        self._ctrl[rows] = qpos[:, 7:].numpy()
        self._refresh()

    def push(self, worlds: torch.Tensor, velocity: torch.Tensor) -> None:
        """Add root velocity to ``worlds``; see the contract."""
        worlds, velocity = numbered(worlds, velocity)
        self._qvel[worlds.numpy(), :6] += velocity.numpy()
        self._refresh()

    def set_parameters(self, parameters: WorldParameters) -> None:
        """Give every world its own contacts of the feet, masses, inertias and centre of mass."""
        scale = parameters.mass_scale.double().numpy()[:, None]
        inertia = scale * parameters.inertia_scale.double().numpy()[:, None]
        friction = (parameters.friction[:, None] * parameters.foot_friction).numpy()
        feet, contact = self._foot_geoms, self._batch.expand("geom_solref")
        self._batch.expand("geom_friction")[:, feet, 0] = friction[:, self._foot_of_geom]
        time = parameters.contact_time.double().numpy() * self.contact_time
        contact[:, feet, 0] = time[:, None]
        contact[:, feet, 1] = parameters.contact_damping.numpy()[:, None]
        self._batch.expand("body_mass")[:] = self.model.body_mass * scale
        self._batch.expand("body_inertia")[:] = self.model.body_inertia * inertia[..., None]
        centre = self.model.body_ipos[self._base] + parameters.base_com_offset.numpy()
        self._batch.expand("body_ipos")[:, self._base] = centre
        self._batch.set_const()

    def state_dict(self) -> dict[str, torch.Tensor]:
        """Everything the engine needs to go on bit for bit: (N, nstate) float64 rows, warm starts
        included.
        """
        return {"rows": torch.from_numpy(self._batch.state.copy())}

    def load_state_dict(self, state: dict[str, torch.Tensor]) -> None:
        """Restore :meth:`state_dict`."""
        self._batch.state[:] = state["rows"].numpy()
        self._refresh()

    def _default_state(self) -> tuple[torch.Tensor, torch.Tensor]:
        qpos = torch.from_numpy(self.model.qpos0).float().repeat(self.num_worlds, 1)
        return qpos, torch.zeros(self.num_worlds, self.model.nv)

    def _refresh(self) -> None:
        # New tensors every time: callers keep the previous step's without copying.
        self.qpos = torch.from_numpy(self._qpos).float()
        self.qvel = torch.from_numpy(self._qvel).float()


def _own_threads() -> int:
    """As many as torch may use where somebody has said so, as for jobs that share a machine; else
    0, all cores.
    """
    told = os.environ.get("OMP_NUM_THREADS", "")
    return int(told) if told.isdecimal() else 0


def numbered(worlds: torch.Tensor, *values: torch.Tensor) -> tuple[torch.Tensor, ...]:
    """A mask (N,) with N rows of values each, as numbers (K,) with K rows; numbers stay as they
    are.
    """
    if worlds.dtype != torch.bool:
        return worlds, *values
    ids = torch.nonzero(worlds).flatten()
    return ids, *(value[ids] for value in values)


def _columns(model: mujoco.MjModel, sensor: str) -> np.ndarray:
    start = model.sensor(sensor).adr[0]
    return np.arange(start, start + 3)


def _norms(sensors: np.ndarray, columns: np.ndarray) -> np.ndarray:
    """(N, S, sensors) and (B, 3) column numbers -> (N, S, B) norms."""
    return np.sqrt(np.square(sensors[..., columns]).sum(axis=-1))
