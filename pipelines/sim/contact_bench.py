"""How stiff contacts are beside a rubber foot, and what they cost: a robot falls onto its feet.

The reference is an elastic ball of rubber that stops what a rigid leg weighs at its foot. That mass
is the foot's share of (J M^-1 J^T)^-1, with J the vertical Jacobians of the feet and M the joint
space inertia, rotors included. Hertz gives the largest force of a ball of radius R and modulus E
that hits a rigid plane with energy m v^2 / 2:

    F = k^(2/5) (5/4 m v^2)^(3/5),  k = 4/3 E / (1 - nu^2) sqrt(R),  nu = 1/2

(K. L. Johnson, *Contact Mechanics*, 1985, section 11.4), and the ball gives way by (F / k)^(2/3).
"""

from __future__ import annotations

import math
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from statistics import mean
from typing import Any

import mujoco
import numpy as np
from mujoco.batch import Batch

from lacoloco.pipelines.sim.physics import CONTROL_DT, SUBSTEPS
from lacoloco.robots.registry import load_robot
from lacoloco.robots.scene import compile_scene
from lacoloco.robots.spec import RobotSpec

RUBBER_MODULUS = 2.5e6
"""Pa: rubber of hardness 50 Shore A, by Gent's relation (1958)."""
HEIGHTS = (0.02, 0.05, 0.10)
"""Drops, m."""
MOMENTS = (0.0, 0.2, 0.4, 0.6, 0.8)
"""Where within a physics step the feet arrive; how far they sink depends on it."""
LANDING_S = 0.3
WORLDS, STEPS, ROUNDS = 256, 40, 7


@dataclass(frozen=True)
class Contact:
    """One way to simulate contacts.

    Attributes:
        name: What it is called in the table.
        substeps: Physics steps per control step.
        time: Time constant of the contact [s], ``solref[0]``.
        damping_ratio: ``solref[1]``.
        impedance: ``solimp``.
    """

    name: str
    substeps: int
    time: float
    damping_ratio: float = 1.0
    impedance: tuple[float, ...] = (0.95, 0.99, 0.001, 0.5, 2.0)


MUJOCO_IMPEDANCE = (0.9, 0.95, 0.001, 0.5, 2.0)


def candidates() -> Iterator[Contact]:
    """MuJoCo's default first, then ever stiffer ones, each as stiff as its step allows."""
    yield Contact("MuJoCo's default", 4, 0.02, impedance=MUJOCO_IMPEDANCE)
    for substeps in (4, 6, 8, 10, 20):
        shortest = 2.0 * CONTROL_DT / substeps
        name = "as stiff as the step allows"
        yield Contact(name, substeps, shortest, impedance=MUJOCO_IMPEDANCE)
        yield Contact(f"{name}, higher impedance", substeps, shortest)
        if substeps == SUBSTEPS:
            yield Contact("the same, softest in training", substeps, 1.5 * shortest)
            yield Contact("the same, least damped in training", substeps, shortest, 0.7)


def bench_contacts(robot: str) -> dict[str, Any]:
    """Peak force on a foot [N], sinking [mm] and speed of every candidate.

    Returns:
        ``reference``: rows by height of what a rubber foot would do; ``rows``: one per candidate,
        with the mean force and the largest sinking over the moments of arrival, the control steps
        per second of processor time, and the time as a multiple of the first candidate's.
    """
    spec = load_robot(robot)
    contacts = list(candidates())
    models = [_model(spec, contact) for contact in contacts]
    rows = [_row(spec, contact, model) for contact, model in zip(contacts, models, strict=True)]
    seconds = _seconds(models, [contact.substeps for contact in contacts])
    for row, times in zip(rows, seconds.T, strict=True):
        row["steps_per_second"] = WORLDS * STEPS / float(np.median(times))
        row["time_ratio"] = float(np.median(times / seconds[:, 0]))
    return {"robot": robot, "reference": reference(spec), "rows": rows}


def reference(spec: RobotSpec) -> list[dict[str, float]]:
    """A rubber foot under a rigid leg, by height of the drop; the heaviest foot counts."""
    mass, radius = float(foot_masses(spec).max()), spec.foot_radius()
    stiffness = 4.0 / 3.0 * RUBBER_MODULUS / 0.75 * math.sqrt(radius)
    rows = []
    for height in HEIGHTS:
        energy = mass * 9.81 * height  # m v^2 / 2
        force = stiffness**0.4 * (2.5 * energy) ** 0.6
        sinking = 1000.0 * (force / stiffness) ** (2.0 / 3.0)
        rows.append({"height_m": height, "mass_kg": mass, "peak_n": force, "sinking_mm": sinking})
    return rows


def foot_masses(spec: RobotSpec) -> np.ndarray:
    """(F,) kg that each foot stops when all feet of the standing robot meet the floor at once."""
    model = compile_scene(spec)
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    mujoco.mj_forward(model, data)
    jacobian = np.zeros((len(spec.feet), model.nv))
    for row, name in enumerate(spec.feet):
        whole = np.zeros((3, model.nv))
        mujoco.mj_jacBody(model, data, whole, None, model.body(name).id)
        jacobian[row] = whole[2]
    inertia = np.zeros((model.nv, model.nv))
    mujoco.mj_fullM(model, data, inertia)
    return np.linalg.inv(jacobian @ np.linalg.solve(inertia, jacobian.T)).sum(axis=1)


def drop(spec: RobotSpec, model: mujoco.MjModel, height: float) -> tuple[float, float]:
    """Largest force on a foot [N] and deepest contact [m] after a fall from ``height`` [m]."""
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    data.qpos[2] += height
    feet = np.array([model.sensor(f"force_{name}").adr[0] for name in spec.feet])
    peak = depth = 0.0
    for _ in range(math.ceil((math.sqrt(2.0 * height / 9.81) + LANDING_S) / model.opt.timestep)):
        mujoco.mj_step(model, data)
        forces = np.linalg.norm(data.sensordata[feet[:, None] + np.arange(3)], axis=1)
        peak = max(peak, float(forces.max()))
        depth = max(depth, float(-data.contact.dist.min(initial=0.0)))
    return peak, depth


def _row(spec: RobotSpec, contact: Contact, model: mujoco.MjModel) -> dict[str, Any]:
    row: dict[str, Any] = {
        "contact": contact.name,
        "substeps": contact.substeps,
        "solref": (contact.time, contact.damping_ratio),
        "solimp": contact.impedance[:2],
    }
    for height in HEIGHTS:
        # A little higher: the feet arrive so much later within a step.
        step = math.sqrt(2.0 * 9.81 * height) * model.opt.timestep
        drops = [drop(spec, model, height + moment * step) for moment in MOMENTS]
        centimetres = round(100 * height)
        row[f"peak_{centimetres}cm_n"] = mean(peak for peak, _ in drops)
        row[f"sinking_{centimetres}cm_mm"] = 1000.0 * max(depth for _, depth in drops)
    return row


def _model(spec: RobotSpec, contact: Contact) -> mujoco.MjModel:
    model = compile_scene(spec, timestep=CONTROL_DT / contact.substeps)
    model.geom_solref[:] = contact.time, contact.damping_ratio
    model.geom_solimp[:] = contact.impedance
    return model


def _seconds(models: Sequence[mujoco.MjModel], substeps: Sequence[int]) -> np.ndarray:
    """(ROUNDS, M) seconds of processor time that ``STEPS`` control steps of ``WORLDS`` worlds take
    each model on one thread, legs moved at random. The models take turns: what else runs on the
    machine slows all of them.
    """
    batches = [Batch(model, WORLDS, nthread=1) for model in models]
    for batch, model in zip(batches, models, strict=True):
        batch.bind("qpos")[:] = model.key_qpos[0]
    return np.array(
        [
            [_turn(*turn) for turn in zip(batches, models, substeps, strict=True)]
            for _ in range(ROUNDS)
        ]
    )


def _turn(batch: Batch, model: mujoco.MjModel, substeps: int) -> float:
    generator = np.random.default_rng(0)
    begin = time.process_time()
    for _ in range(STEPS):
        swing = generator.normal(0.0, 0.1, (WORLDS, model.nu))
        batch.bind("ctrl")[:] = model.key_qpos[0, 7:] + swing
        batch.step(nstep=substeps)
    return time.process_time() - begin
