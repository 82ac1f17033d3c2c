"""The contract between the environments and a physics engine.

Conventions, the same for every engine: ``N`` worlds, ``J`` actuated joints, ``F`` feet, ``B`` monitored bodies, ``S``
physics substeps per control step. All tensors are float32 on :attr:`Physics.device`.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import torch

from lacoloco.pipelines.errors import StageError
from lacoloco.robots.spec import RobotSpec

CONTROL_DT = 0.02
"""Seconds between two actions (50 Hz, paper section IV)."""
PHYSICS_DT = 0.005
SUBSTEPS = round(CONTROL_DT / PHYSICS_DT)
ENGINE_VARIABLE = "LACOLOCO_PHYSICS"
"""Environment variable; ``warp`` forces MuJoCo Warp on the CPU."""


@dataclass(frozen=True)
class WorldParameters:
    """What differs between worlds; every field has one row per world.

    Attributes:
        friction: (N,) sliding friction of the feet on the ground.
        mass_scale: (N,) factor on every body mass.
        inertia_scale: (N,) further factor on every body inertia.
        base_com_offset: (N, 3) shift of the base's centre of mass, metres, base frame.
    """

    friction: torch.Tensor
    mass_scale: torch.Tensor
    inertia_scale: torch.Tensor
    base_com_offset: torch.Tensor


class Physics(Protocol):
    """N independent worlds of one robot on flat ground. Every refresh makes new tensors, so old ones may be kept.

    Attributes:
        qpos: (N, 7 + J) root position [m, world], root quaternion wxyz, joint positions [rad].
        qvel: (N, 6 + J) root linear velocity [m/s, world], root angular velocity [rad/s, base frame], joints [rad/s].
        foot_force: (N, S, F) norm of the net contact force on each foot [N], one row per substep of the last step.
        body_force: (N, B) largest norm of the net contact force on each monitored body during the last step [N].
        torque: (N, J) joint torques applied in the last substep [N.m].
        diverged: (N,) bool, worlds whose state became invalid during the last step (the engine has reset them).
        monitored: the names of the B monitored bodies: fall bodies first, then the undesired contacts.
    """

    num_worlds: int
    device: torch.device
    qpos: torch.Tensor
    qvel: torch.Tensor
    foot_force: torch.Tensor
    body_force: torch.Tensor
    torque: torch.Tensor
    diverged: torch.Tensor
    monitored: tuple[str, ...]

    def step(self, targets: torch.Tensor) -> None:
        """Hold joint position targets (N, J) [rad] for one control step and refresh every attribute."""

    def reset(self, worlds: torch.Tensor, qpos: torch.Tensor, qvel: torch.Tensor) -> None:
        """Put ``worlds``, numbers (K,) or a mask (N,), into states (K or N, 7 + J), (K or N, 6 + J)."""

    def push(self, worlds: torch.Tensor, velocity: torch.Tensor) -> None:
        """Add (K or N, 6) root velocity (linear in world, angular in base frame) to ``worlds``, numbers or a mask."""

    def set_parameters(self, parameters: WorldParameters) -> None:
        """Give every world its own friction, masses, inertias and centre of mass."""

    def state_dict(self) -> dict[str, torch.Tensor]:
        """Everything needed to go on exactly from here, world parameters excepted."""

    def load_state_dict(self, state: dict[str, torch.Tensor]) -> None:
        """Restore :meth:`state_dict`."""


@dataclass(frozen=True)
class PhysicsRequest:
    """What to simulate: a robot, how many worlds, and which torque limits the motors have."""

    spec: RobotSpec
    num_worlds: int
    training_limits: bool = True
    threads: int = 0


def monitored_bodies(spec: RobotSpec) -> tuple[str, ...]:
    """Bodies whose contact force is watched: fall bodies first, then the undesired contacts, without repetition."""
    return tuple(dict.fromkeys((*spec.fall_bodies, *spec.undesired_contact_bodies)))


def make_physics(request: PhysicsRequest, device: str = "cpu") -> Physics:
    """Build the engine for a device: MuJoCo's native batch engine on the CPU, MuJoCo Warp on a GPU.

    ``LACOLOCO_PHYSICS=warp`` takes Warp on the CPU too, where it is some ten times slower: for tests.

    Raises:
        StageError: the device has no engine, or what it needs is not there.
    """
    engines: dict[str, Callable[[PhysicsRequest, str], Physics]] = {"cpu": _batch, "cuda": _warp}
    kind = device.split(":")[0]
    if kind not in engines:
        raise StageError(f"--device {device}: no physics engine for it; use --device cpu or cuda")
    return engines["cuda" if _forced_to_warp() else kind](request, device)


def _forced_to_warp() -> bool:
    wanted = os.environ.get(ENGINE_VARIABLE, "")
    if wanted not in ("", "warp"):
        raise StageError(f"{ENGINE_VARIABLE}={wanted}: set it to warp, or unset it")
    return wanted == "warp"


def _batch(request: PhysicsRequest, device: str) -> Physics:
    from lacoloco.pipelines.sim.mujoco_cpu import BatchPhysics

    return BatchPhysics(request)


def _warp(request: PhysicsRequest, device: str) -> Physics:
    if device.startswith("cuda") and not torch.cuda.is_available():
        raise StageError(f"--device {device}: torch finds no CUDA device; use --device cpu")
    try:
        from lacoloco.pipelines.sim.mujoco_warp import WarpPhysics
    except ModuleNotFoundError as error:
        raise StageError(f"--device {device}: {error.name} is missing; pip install 'lacoloco[gpu]'") from error
    return WarpPhysics(request, device)
