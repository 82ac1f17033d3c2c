"""MuJoCo Warp against MuJoCo's C engine: one control step from equal states.

Warp computes in single precision, so states that start equal drift apart; one step is what an error
cannot grow in.
"""

from __future__ import annotations

from collections.abc import Iterator

import mujoco
import torch

from lacoloco.pipelines.errors import StageError
from lacoloco.pipelines.sim.mujoco_cpu import BatchPhysics
from lacoloco.pipelines.sim.physics import Physics, PhysicsRequest, WorldParameters
from lacoloco.robots.scene import compile_scene
from lacoloco.robots.spec import RobotSpec

ROUNDS = 4
SHARE = 0.99
"""Share of the worlds that must agree: in a few, a foot that just touches does so in another
substep.
"""
TOLERANCES = {"qpos": 1e-5, "qvel": 1e-3, "torque": 5e-3, "foot_force": 1e-3, "body_force": 1e-3}
"""Largest difference, in m and rad, m/s and rad/s, N.m, and forces as shares of the robot's weight.
On the CPU, Warp stays below a twentieth of these (64 worlds, Solo12 and H1).
"""


def check_parity(spec: RobotSpec, device: str, worlds: int = 256) -> dict[str, float]:
    """Compare the engine of ``device`` (MuJoCo Warp, also on the CPU) with the C engine in random
    worlds near the ground.

    Masses, inertias, centres of mass and friction are drawn per world; targets are random.

    Returns:
        The largest difference of every quantity in ``SHARE`` of the worlds, and ``touching``, the
        share of feet on the ground.

    Raises:
        StageError: a difference beyond its tolerance, or no MuJoCo Warp.
    """
    try:
        from lacoloco.pipelines.sim.mujoco_warp import WarpPhysics
    except ModuleNotFoundError as error:
        raise StageError(f"{error.name} is missing; pip install 'lacoloco[gpu]'") from error
    request = PhysicsRequest(spec, worlds)
    engines: tuple[Physics, Physics] = (WarpPhysics(request, device), BatchPhysics(request))
    generator = torch.Generator().manual_seed(0)
    parameters = _parameters(worlds, len(spec.feet), generator)
    for engine in engines:
        engine.set_parameters(parameters)
    rounds = [_one_step(spec, engines, worlds, generator) for _ in range(ROUNDS)]
    metrics = {
        name: float(torch.cat([differences[name] for differences in rounds]).quantile(SHARE))
        for name in rounds[0]
        if name != "touching"
    }
    for name, found in metrics.items():
        if not found <= TOLERANCES[name]:
            raise StageError(
                f"{spec.name} on {device}: MuJoCo Warp and the C engine differ in {name} by "
                f"{found:.2g} after one step "
                f"from equal states (tolerance {TOLERANCES[name]:g}): its results cannot be trusted"
            )
    touching = float(torch.stack([differences["touching"] for differences in rounds]).mean())
    return {**metrics, "touching": touching}


def _one_step(
    spec: RobotSpec, engines: tuple[Physics, Physics], worlds: int, generator: torch.Generator
) -> dict[str, torch.Tensor]:
    """(N,) largest difference per world and quantity after one control step."""
    qpos, qvel = near_the_ground(spec, worlds, generator)
    targets = qpos[:, 7:] + 0.2 * torch.randn(worlds, spec.num_joints, generator=generator)
    for engine in engines:
        values = (value.to(engine.device) for value in (torch.arange(worlds), qpos, qvel))
        engine.reset(*values)
        engine.step(targets.to(engine.device))
    scale = {name: 1.0 / spec.weight() if "force" in name else 1.0 for name in TOLERANCES}
    differences = {
        name: scale[name] * _difference(*(getattr(engine, name) for engine in engines))
        for name in TOLERANCES
    }
    return {**differences, "touching": (engines[1].foot_force[:, -1] > 1.0).float().mean()}


def _difference(first: torch.Tensor, second: torch.Tensor) -> torch.Tensor:
    distance = (first.cpu() - second.cpu()).abs()
    return torch.nan_to_num(distance, nan=torch.inf).flatten(1).amax(dim=1)


def near_the_ground(
    spec: RobotSpec, worlds: int, generator: torch.Generator
) -> tuple[torch.Tensor, torch.Tensor]:
    """(N, 7 + J), (N, 6 + J): tilted robots in motion, the lowest foot up to 10 mm in the floor or
    above it.
    """
    model, joints = compile_scene(spec), spec.num_joints
    qpos = torch.zeros(worlds, 7 + joints)
    qpos[:, 3], qpos[:, 4:7] = 1.0, 0.1 * torch.randn(worlds, 3, generator=generator)
    qpos[:, 3:7] /= qpos[:, 3:7].norm(dim=-1, keepdim=True)
    qpos[:, 7:] = torch.tensor(spec.default_joint_pos) + 0.1 * torch.randn(
        worlds, joints, generator=generator
    )
    gap = 0.01 * (2.0 * torch.rand(worlds, generator=generator) - 1.0)
    qpos[:, 2] = gap - torch.tensor(list(_lowest_feet(spec, model, qpos)))
    return qpos, 0.5 * torch.randn(worlds, 6 + joints, generator=generator)


def _lowest_feet(spec: RobotSpec, model: mujoco.MjModel, qpos: torch.Tensor) -> Iterator[float]:
    data = mujoco.MjData(model)
    for row in qpos.double().numpy():
        data.qpos[:] = row
        mujoco.mj_kinematics(model, data)
        yield min(data.body(name).xpos[2] for name in spec.feet) - spec.foot_radius()


def _parameters(worlds: int, feet: int, generator: torch.Generator) -> WorldParameters:
    def uniform(low: float, high: float, *shape: int) -> torch.Tensor:
        return low + (high - low) * torch.rand(*shape, generator=generator)

    return WorldParameters(
        friction=uniform(0.4, 1.4, worlds),
        foot_friction=uniform(0.9, 1.1, worlds, feet),
        contact_time=uniform(1.0, 1.5, worlds),
        contact_damping=uniform(0.7, 1.2, worlds),
        mass_scale=uniform(0.8, 1.2, worlds),
        inertia_scale=uniform(0.8, 1.2, worlds),
        base_com_offset=uniform(-0.02, 0.02, worlds, 3),
    )
