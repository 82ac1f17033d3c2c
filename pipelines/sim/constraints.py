"""Constraint functions for Constraints as Terminations: c > 0 is a violation (the
paper's equation for delta; the original's code).

Every function maps an environment after a step to an (N, k) tensor of signed margins in its own
unit, one column per foot, joint or body. :mod:`lacoloco.pipelines.learn.cat` turns them into
termination probabilities.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch

from lacoloco.pipelines.sim.physics import CONTROL_DT
from lacoloco.pipelines.sim.registered import Registered
from lacoloco.pipelines.sim.world import World
from lacoloco.robots.spec import RobotSpec


@dataclass(frozen=True)
class Constraint:
    """A named constraint, its limit in the function's unit, and the largest termination probability
    it may cause.

    Attributes:
        name: Key of ``CONSTRAINTS``.
        limit: One for all columns, or one for each of them.
        max_p: Largest termination probability.
    """

    name: str
    limit: float | tuple[float, ...]
    max_p: float


Limit = float | torch.Tensor
"""One limit for all columns of a constraint, or a row of one for each: (k,)."""


def own_limit(spec: RobotSpec, name: str) -> float | tuple[float, ...] | None:
    """The limit that a robot itself has for a constraint, in the function's unit.

    Returns:
        Torque [N.m] and speed [rad/s] of each motor, or the force on a foot [N]; None where a robot
        has no such limit.
    """
    if name == "torque":
        return tuple(float(limit) for limit in spec.effort_limits())
    if name == "joint_velocity":
        return spec.velocity_limits
    return spec.foot_force_limit() if name == "foot_force" else None


def foot_force(env: World, limit: Limit) -> torch.Tensor:
    """(N, F) largest net contact force of each foot over *all* substeps, minus the limit [N]."""
    return env.physics.foot_force.amax(dim=1) - limit


def torque(env: World, limit: Limit) -> torch.Tensor:
    """(N, J) |joint torque| minus the limit [N.m]."""
    return env.physics.torque.abs() - limit


def joint_velocity(env: World, limit: Limit) -> torch.Tensor:
    """(N, J) |joint velocity| minus the limit [rad/s]."""
    return env.state.joint_vel.abs() - limit


def joint_acceleration(env: World, limit: Limit) -> torch.Tensor:
    """(N, J) |mean joint acceleration of the step| minus the limit [rad/s^2]."""
    return (env.state.joint_vel - env.previous.joint_vel).abs() / CONTROL_DT - limit


def action_rate(env: World, limit: Limit) -> torch.Tensor:
    """(N, J) |change of the raw action per second| minus the limit [1/s]."""
    return (env.action - env.previous_action).abs() / CONTROL_DT - limit


def undesired_contact(env: World, limit: Limit) -> torch.Tensor:
    """(N, B) contact force of bodies that should touch nothing, minus the limit [N]."""
    return env.physics.body_force - limit


def base_tilt(env: World, limit: Limit) -> torch.Tensor:
    """(N, 1) horizontal part of the projected gravity minus the limit."""
    return torch.linalg.vector_norm(env.state.gravity_b[:, :2], dim=-1, keepdim=True) - limit


def air_time(env: World, limit: Limit) -> torch.Tensor:
    """(N, F) seconds by which a foot's flight fell short of the limit, at its touch-down, while
    commanded to move.
    """
    shortfall = (limit - env.feet.last_air_time) * env.feet.touch_down
    return shortfall * (env.command_speed() > 0.1)[:, None]


def stand_still(env: World, limit: Limit) -> torch.Tensor:
    """(N, J) |joint velocity| above the limit [rad/s] while commanded to stand."""
    return (env.state.joint_vel.abs() - limit) * (env.command_speed() <= 0.1)[:, None]


def abduction_deviation(env: World, limit: Limit) -> torch.Tensor:
    """(N, A) abduction joints away from the default pose [rad] minus the limit, while no lateral
    speed is commanded.
    """
    columns = env.abduction_columns
    deviation = (env.state.joint_pos[:, columns] - env.default_joint_pos[columns]).abs() - limit
    return deviation * (env.command[:, 1].abs() < 0.1)[:, None]


CONSTRAINTS: dict[str, Registered] = {
    "foot_force": Registered(foot_force),
    "torque": Registered(torque),
    "joint_velocity": Registered(joint_velocity),
    "joint_acceleration": Registered(joint_acceleration),
    "action_rate": Registered(action_rate),
    "undesired_contact": Registered(undesired_contact),
    "base_tilt": Registered(base_tilt),
    "air_time": Registered(air_time, ("velocity",)),
    "stand_still": Registered(stand_still, ("velocity",)),
    "abduction_deviation": Registered(abduction_deviation, ("velocity",)),
}
