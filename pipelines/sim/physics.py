"""The contract between the environments and a physics engine.

Conventions, the same for every engine: ``N`` worlds, ``J`` actuated joints, ``F`` feet, ``B``
monitored bodies, ``S`` physics substeps per control step. All tensors are float32 on
:attr:`Physics.device`.
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Protocol

import torch

from lacoloco.pipelines.sim.disturbances.config import UNDISTURBED, Disturbances
from lacoloco.robots.spec import RobotSpec

CONTROL_DT = 0.02
"""Seconds between two actions (50 Hz, paper section IV)."""
SUBSTEPS = 6
PHYSICS_DT = CONTROL_DT / SUBSTEPS
"""Seconds between two physics steps: what the stiffness of a foot's rubber needs."""


@dataclass(frozen=True)
class WorldParameters:
    """What differs between worlds; every field has one row per world.

    Attributes:
        friction: (N,) sliding friction of the feet on the ground.
        foot_friction: (N, F) further factor on it, foot by foot.
        contact_time: (N,) factor on the time constant of the feet's contacts, at least 1.
        contact_damping: (N,) damping ratio of the feet's contacts.
        mass_scale: (N,) factor on every body mass.
        inertia_scale: (N,) further factor on every body inertia.
        base_com_offset: (N, 3) shift of the base's centre of mass, metres, base frame.
    """

    friction: torch.Tensor
    foot_friction: torch.Tensor
    contact_time: torch.Tensor
    contact_damping: torch.Tensor
    mass_scale: torch.Tensor
    inertia_scale: torch.Tensor
    base_com_offset: torch.Tensor

    def replaced(self, mask: torch.Tensor, others: WorldParameters) -> WorldParameters:
        """Those of ``others`` in the worlds of ``mask`` (N,) bool."""
        pairs = zip(self.columns().values(), others.columns().values(), strict=True)
        return WorldParameters(
            *(torch.where(mask.view(-1, *(1,) * (old.ndim - 1)), new, old) for old, new in pairs)
        )

    def columns(self) -> dict[str, torch.Tensor]:
        """The fields by name."""
        return {field.name: getattr(self, field.name) for field in fields(self)}


class Physics(Protocol):
    """N independent worlds of one robot on flat ground. Every refresh makes new tensors, so old
    ones may be kept.

    Attributes:
        qpos: (N, 7 + J) root position [m, world], root quaternion wxyz, joint positions [rad].
        qvel: (N, 6 + J) root linear velocity [m/s, world], root angular velocity [rad/s, base
            frame], joints [rad/s].
        foot_force: (N, S, F) norm of the net contact force on each foot [N], one row per substep of
            the last step.
        body_force: (N, B) largest norm of the net contact force on each monitored body during the
            last step [N].
        torque: (N, J) joint torques applied in the last substep [N.m].
        diverged: (N,) bool, worlds whose state became invalid during the last step (the engine has
            reset them).
        monitored: the names of the B monitored bodies: fall bodies first, then the undesired
            contacts.
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
        """Hold joint position targets (N, J) [rad] for one control step and refresh every
        attribute.
        """

    def reset(self, worlds: torch.Tensor, qpos: torch.Tensor, qvel: torch.Tensor) -> None:
        """Put ``worlds``, numbers (K,) or a mask (N,), into states (K or N, 7 + J), (K or N, 6 +
        J).
        """

    def push(self, worlds: torch.Tensor, velocity: torch.Tensor) -> None:
        """Add (K or N, 6) root velocity (linear in world, angular in base frame) to ``worlds``,
        numbers or a mask.
        """

    def set_parameters(self, parameters: WorldParameters) -> None:
        """Give every world its own contacts of the feet, masses, inertias and centre of mass."""

    def state_dict(self) -> dict[str, torch.Tensor]:
        """Everything needed to go on exactly from here, world parameters excepted."""

    def load_state_dict(self, state: dict[str, torch.Tensor]) -> None:
        """Restore :meth:`state_dict`."""


@dataclass(frozen=True)
class PhysicsRequest:
    """What to simulate: a robot, how many worlds, which torque limits the motors have, and what is
    not as in the model, drawn from ``seed``.
    """

    spec: RobotSpec
    num_worlds: int
    training_limits: bool = True
    threads: int = 0
    disturbances: Disturbances = UNDISTURBED
    seed: int = 0


def monitored_bodies(spec: RobotSpec) -> tuple[str, ...]:
    """Bodies whose contact force is watched: fall bodies first, then the undesired contacts,
    without repetition.
    """
    return tuple(dict.fromkeys((*spec.fall_bodies, *spec.undesired_contact_bodies)))
