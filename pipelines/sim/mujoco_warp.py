"""The GPU engine: MuJoCo Warp, with the substeps of a control step in one captured graph. Runs
on the CPU too, slowly.

Torch and Warp share the memory of the state and run on one stream, torch's, so nothing is copied
between them and nothing waits for the device: divergence is handled by masks, and running out of
room is noticed a little later.
"""

from __future__ import annotations

import gc
from collections.abc import Iterator
from contextlib import contextmanager

import mujoco_warp as mjw
import torch
import warp as wp

from lacoloco.pipelines.masking import pick, put
from lacoloco.pipelines.sim.capacity import find_capacity
from lacoloco.pipelines.sim.physics import (
    PHYSICS_DT,
    SUBSTEPS,
    PhysicsRequest,
    WorldParameters,
    monitored_bodies,
)
from lacoloco.robots.geometry import foot_geoms
from lacoloco.robots.scene import compile_scene, contact_time

# Its greeting and its list of compiled modules go to stdout, where a verb's answer belongs.
wp.config.log_level = wp.LOG_WARNING

RANDOMISED = ("geom_friction", "geom_solref", "body_mass", "body_inertia", "body_ipos")
DERIVED = ("body_subtreemass", "body_invweight0", "dof_invweight0", "actuator_acc0")
"""Model fields with one row per world: what is drawn, and what MuJoCo derives from it."""
LARGEST = 1e10
"""A coordinate beyond this has diverged (MuJoCo's ``mjMAXVAL``)."""
LOOK_EVERY = 64
"""Control steps between two looks at the overflow flags."""
_OVERFLOW = mjw.OverflowType
_OUT_OF_CONTACTS = _OVERFLOW.BROADPHASE | _OVERFLOW.NARROWPHASE | _OVERFLOW.CCD
_OUT_OF_CONSTRAINTS = _OVERFLOW.NEFC | _OVERFLOW.NJMAX_NNZ


class WarpPhysics:
    """:class:`~lacoloco.pipelines.sim.physics.Physics` on MuJoCo Warp; ``device`` is ``cuda``,
    ``cuda:1``, ... or ``cpu``.

    The torch stream that is current while this is built is the one to use it on.
    """

    def __init__(self, request: PhysicsRequest, device: str = "cpu") -> None:
        """Compile the robot, allocate the worlds in the model's default state, and run every kernel
        once.
        """
        spec, self.num_worlds = request.spec, request.num_worlds
        self.device = _torch_device(device)
        self.model = compile_scene(
            spec, timestep=PHYSICS_DT, training_limits=request.training_limits
        )
        self.monitored = monitored_bodies(spec)
        self._capacity = find_capacity(self.model)
        self._stream = wp.stream_from_torch(self.device) if self.device.type == "cuda" else None
        self._graph: wp.Graph | None = None
        self._allocate()
        self._feet = self._columns(spec.feet)
        self._bodies = self._columns(self.monitored)
        geoms, feet = foot_geoms(self.model, spec.feet)
        self._foot_geoms, self._foot_of_geom = self._indices(geoms), self._indices(feet)
        self._base = int(self.model.jnt_bodyid[0])
        self._start = torch.tensor(self.model.qpos0, dtype=torch.float32, device=self.device)
        self._flags = torch.zeros(1, dtype=torch.int32, pin_memory=self.device.type == "cuda")
        self._steps = 0
        self.step(torch.zeros(self.num_worlds, self.model.nu, device=self.device))
        self.reset(torch.arange(self.num_worlds, device=self.device), *self._default_state())

    def step(self, targets: torch.Tensor) -> None:
        """Hold joint targets (N, J) [rad] for one control step; see the contract."""
        diverged = ~(self._in_bounds() & _all(targets.isfinite()))
        self._ctrl.copy_(targets)
        self._advance()
        diverged |= ~self._in_bounds()
        self.diverged = diverged
        self._restart(diverged)
        sensors = self._sensors.masked_fill(diverged[None, :, None], 0.0)
        self.foot_force = sensors[..., self._feet].norm(dim=-1).transpose(0, 1).contiguous()
        self.body_force = sensors[..., self._bodies].norm(dim=-1).amax(dim=0)
        self.torque = self._motor_force.masked_fill(diverged[:, None], 0.0)
        self._refresh()
        self._look_for_overflow()

    def reset(self, worlds: torch.Tensor, qpos: torch.Tensor, qvel: torch.Tensor) -> None:
        """Put ``worlds`` into the given states; see the contract.

        Only what the next step reads is written. Warp's own ``reset_data`` also empties the contact
        list, which all worlds share, whenever world 0 is among those to reset.
        """
        for target, value in ((self._qpos, qpos), (self._qvel, qvel), (self._ctrl, qpos[:, 7:])):
            put(target, worlds, value)
        put(self._warm_start, worlds, 0.0)
        put(self._time, worlds, 0.0)
        self._refresh()

    def push(self, worlds: torch.Tensor, velocity: torch.Tensor) -> None:
        """Add root velocity to ``worlds``; see the contract."""
        put(self._qvel[:, :6], worlds, pick(self._qvel[:, :6], worlds) + velocity)
        self._refresh()

    def set_parameters(self, parameters: WorldParameters) -> None:
        """Give every world its own contacts of the feet, masses, inertias and centre of mass."""
        own = {name: wp.to_torch(getattr(self._model, name)) for name in RANDOMISED}
        scale = parameters.mass_scale.to(self.device)[:, None]
        inertia = scale * parameters.inertia_scale.to(self.device)[:, None]
        friction = (parameters.friction[:, None] * parameters.foot_friction).to(self.device)
        feet, contact = self._foot_geoms, own["geom_solref"]
        own["geom_friction"][:, feet, 0] = friction[:, self._foot_of_geom]
        time = parameters.contact_time.to(self.device) * contact_time(PHYSICS_DT)
        contact[:, feet, 0] = time[:, None]
        contact[:, feet, 1] = parameters.contact_damping.to(self.device)[:, None]
        own["body_mass"].copy_(self._tensor(self.model.body_mass) * scale)
        own["body_inertia"].copy_(self._tensor(self.model.body_inertia) * inertia[..., None])
        centre = self._tensor(self.model.body_ipos[self._base])
        own["body_ipos"][:, self._base] = centre + parameters.base_com_offset.to(self.device)
        with self._on_stream():
            mjw.set_const(self._model, self._data)

    def state_dict(self) -> dict[str, torch.Tensor]:
        """Everything the engine needs to go on: coordinates, controls, warm starts, clocks; one row
        per world.
        """
        self._look_for_overflow(now=True)
        return {name: tensor.clone() for name, tensor in self._state.items()}

    def load_state_dict(self, state: dict[str, torch.Tensor]) -> None:
        """Restore :meth:`state_dict`."""
        for name, tensor in self._state.items():
            tensor.copy_(state[name])
        self._refresh()

    def _allocate(self) -> None:
        """The model with its per-world fields, the data, and torch's views of both."""
        n = self.num_worlds
        with self._on_stream():
            self._model = mjw.put_model(
                self.model, batch_sizes=dict.fromkeys((*RANDOMISED, *DERIVED), n)
            )
            # The kernels must not print: overflows are reported below, and a capped solver
            # iteration is no overflow.
            self._model.opt.warn_overflow = False
            room = self._capacity
            self._data = mjw.make_data(self.model, n, nconmax=room.contacts, njmax=room.constraints)
            self._record = wp.zeros((SUBSTEPS, n, self.model.nsensordata), dtype=float)
        data = self._data
        self._qpos, self._qvel, self._ctrl = (
            wp.to_torch(array) for array in (data.qpos, data.qvel, data.ctrl)
        )
        self._warm_start, self._time = wp.to_torch(data.qacc_warmstart), wp.to_torch(data.time)
        self._state = {
            "qpos": self._qpos,
            "qvel": self._qvel,
            "ctrl": self._ctrl,
            "warm_start": self._warm_start,
            "time": self._time,
        }
        self._acceleration, self._overflow = wp.to_torch(data.qacc), wp.to_torch(data.overflow)
        self._sensors, self._motor_force = (
            wp.to_torch(self._record),
            wp.to_torch(data.actuator_force),
        )

    def _advance(self) -> None:
        with self._on_stream():
            if self._stream is None:
                self._substeps()
            elif self._graph is None:
                self._substeps()  # compiles what is missing, which must not happen during a capture
                self._graph = self._capture()
            else:
                wp.capture_launch(self._graph, stream=self._stream)

    def _substeps(self) -> None:
        for substep in range(SUBSTEPS):
            mjw.step(self._model, self._data)
            wp.copy(self._record[substep], self._data.sensordata)

    def _capture(self) -> wp.Graph:
        """Record the substeps without running them. Torch's default stream cannot be captured, a
        stream of Warp's can.
        """
        assert self._stream is not None
        wp.synchronize_device(self._stream.device)
        gc.collect()
        gc.disable()  # an array freed during the capture would spoil it
        try:
            with (
                wp.ScopedStream(wp.Stream(self._stream.device)),
                wp.ScopedCapture(force_module_load=False) as capture,
            ):
                self._substeps()
        finally:
            gc.enable()
        return capture.graph

    def _in_bounds(self) -> torch.Tensor:
        """(N,) bool: no coordinate, velocity or acceleration is huge or no number (comparisons with
        those are false).
        """
        return torch.stack(
            [
                _all(tensor.abs() < LARGEST)
                for tensor in (self._qpos, self._qvel, self._acceleration)
            ]
        ).all(dim=0)

    def _restart(self, diverged: torch.Tensor) -> None:
        """Put diverged worlds into the default state, as MuJoCo itself does on the CPU."""
        put(self._qpos, diverged, self._start)
        for tensor in (self._qvel, self._ctrl, self._warm_start, self._acceleration, self._time):
            put(tensor, diverged, 0.0)

    def _look_for_overflow(self, now: bool = False) -> None:
        """Raise if a capacity was exceeded by the time of the last look; looking itself waits for
        nothing.

        Raises:
            StageError: contacts or constraint rows ran out; the message names the number to raise.
        """
        self._steps += 1
        if self._steps % LOOK_EVERY == 0 or now:
            flags = int(self._flags)
            if flags:
                raise self._capacity.refuse(contacts=bool(flags & _OUT_OF_CONTACTS))
            serious = self._overflow & int(_OUT_OF_CONTACTS | _OUT_OF_CONSTRAINTS)
            self._flags.copy_(serious.amax(dim=0, keepdim=True), non_blocking=True)

    @contextmanager
    def _on_stream(self) -> Iterator[None]:
        """Allocate and launch on this engine's device and, on a GPU, on torch's stream."""
        if self._stream is None:
            with wp.ScopedDevice("cpu"):
                yield
        else:
            with wp.ScopedStream(self._stream, sync_enter=False):
                yield

    def _columns(self, bodies: tuple[str, ...]) -> torch.Tensor:
        starts = [int(self.model.sensor(f"force_{body}").adr[0]) for body in bodies]
        return self._indices([[start, start + 1, start + 2] for start in starts])

    def _indices(self, values: list) -> torch.Tensor:
        return torch.tensor(values, dtype=torch.long, device=self.device)

    def _tensor(self, values: object) -> torch.Tensor:
        return torch.as_tensor(values, dtype=torch.float32, device=self.device)

    def _default_state(self) -> tuple[torch.Tensor, torch.Tensor]:
        return self._start.repeat(self.num_worlds, 1), torch.zeros_like(self._qvel)

    def _refresh(self) -> None:
        # New tensors every time: callers keep the previous step's without copying.
        self.qpos, self.qvel = self._qpos.clone(), self._qvel.clone()


def _all(mask: torch.Tensor) -> torch.Tensor:
    return mask.all(dim=-1)


def _torch_device(device: str) -> torch.device:
    found = torch.device(device)
    return (
        torch.device("cuda", torch.cuda.current_device())
        if found == torch.device("cuda")
        else found
    )
