"""Reward terms: environment after a step -> (N,) reward per control step. Tasks list them by name
with a weight.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import torch

from lacoloco.pipelines.sim.commands import heading_error
from lacoloco.pipelines.sim.physics import CONTROL_DT
from lacoloco.pipelines.sim.world import World


class RewardTerm(NamedTuple):
    """A registered reward term in a task.

    Attributes:
        name: A key of ``REWARDS``.
        weight: Factor on it.
        parameters: (name, value) pairs of its function.
    """

    name: str
    weight: float
    parameters: tuple[tuple[str, float], ...] = ()

    def __call__(self, env: World) -> torch.Tensor:
        """(N,) its value, before the weight."""
        return REWARDS[self.name].function(env, **dict(self.parameters))


def track_planar_velocity(env: World, variance: float) -> torch.Tensor:
    """exp(-|v_xy - v_xy*|^2 / variance), base frame; the original has 0.25 [m^2/s^2]."""
    error = env.state.lin_vel_b[:, :2] - env.command[:, :2]
    return torch.exp(-error.square().sum(dim=-1) / variance)


def track_yaw_rate(env: World, variance: float) -> torch.Tensor:
    """exp(-(w_z - w_z*)^2 / variance); the original has 0.25 [rad^2/s^2]."""
    return torch.exp(-(env.state.ang_vel_b[:, 2] - env.command[:, 2]).square() / variance)


def track_heading(env: World, variance: float) -> torch.Tensor:
    """exp(-error^2 / variance) of the angle from the base's heading to the asked one [rad^2]."""
    error = heading_error(env.command, env.state)
    return torch.exp(-error.square() / variance)


def reach(env: World, sharpness: float) -> torch.Tensor:
    """exp(-sharpness |p_ee - p*|), the paper's task reward with 10 [1/m]."""
    return torch.exp(-sharpness * env.target_error())


def progress(env: World) -> torch.Tensor:
    """Speed at which the end effector approaches its target [m/s]: potential-based shaping with the
    distance.

    exp(-10 d) is 1e-6 at the distance where an episode starts, far below what a critic can resolve.
    """
    return (env.previous_target_error - env.target_error()) / CONTROL_DT


def approach(env: World, length: float) -> torch.Tensor:
    """exp(-|p_ee - p*| / length): a wide slope for an expert that starts far from its targets."""
    return torch.exp(-env.target_error() / length)


def lift(env: World, length: float) -> torch.Tensor:
    """exp(-|z_ee - z*| / length): pays for height alone, so that the end effector is lifted before
    it finds its target.
    """
    return torch.exp(-(env.end_effector()[:, 2] - env.command[:, 2]).abs() / length)


def hold_height(env: World, length: float) -> torch.Tensor:
    """exp(-|z_ee - z*| / length) for a height that the end effector is asked to hold [m]."""
    return lift(env, length)


def joint_speed(env: World) -> torch.Tensor:
    """Sum of squared joint velocities [rad^2/s^2]."""
    return env.state.joint_vel.square().sum(dim=-1)


def joint_torque(env: World) -> torch.Tensor:
    """Sum of squared torques [N^2 m^2]."""
    return env.physics.torque.square().sum(dim=-1)


def action_change(env: World) -> torch.Tensor:
    """Sum of squared changes of the raw action."""
    return (env.action - env.previous_action).square().sum(dim=-1)


def joint_acceleration(env: World) -> torch.Tensor:
    """Sum of squared mean joint accelerations of the step [rad^2/s^4]."""
    return ((env.state.joint_vel - env.previous.joint_vel) / CONTROL_DT).square().sum(dim=-1)


def tilt(env: World) -> torch.Tensor:
    """Squared horizontal part of the projected gravity."""
    return env.state.gravity_b[:, :2].square().sum(dim=-1)


def vertical_motion(env: World) -> torch.Tensor:
    """v_z^2 + 0.05 (w_x^2 + w_y^2), base frame."""
    return env.state.lin_vel_b[:, 2].square() + 0.05 * env.state.ang_vel_b[:, :2].square().sum(
        dim=-1
    )


def posture(env: World) -> torch.Tensor:
    """Sum of squared joint deviations from the default pose [rad^2]."""
    return (env.state.joint_pos - env.default_joint_pos).square().sum(dim=-1)


def alive(env: World) -> torch.Tensor:
    """1 in every step."""
    return torch.ones_like(env.state.root_pos[:, 0])


def planar_speed(env: World) -> torch.Tensor:
    """v_x^2 + v_y^2, base frame [m^2/s^2]."""
    return env.state.lin_vel_b[:, :2].square().sum(dim=-1)


def displacement(env: World) -> torch.Tensor:
    """Squared distance of the base from where the world begins [m^2], at most 1."""
    return env.state.root_pos[:, :2].square().sum(dim=-1).clamp_max(1.0)


def track_mean_planar_velocity(env: World, variance: float) -> torch.Tensor:
    """exp(-|v_xy - v_xy*|^2 / variance) of the velocity without the sway of single steps."""
    error = env.gait.mean_velocity[:, :2] - env.command[:, :2]
    return torch.exp(-error.square().sum(dim=-1) / variance)


def track_mean_yaw_rate(env: World, variance: float) -> torch.Tensor:
    """The same of the yaw rate."""
    return torch.exp(-(env.gait.mean_velocity[:, 2] - env.command[:, 2]).square() / variance)


def contact_schedule(env: World) -> torch.Tensor:
    """Share of the feet that touch, or do not, as the gait clock asks."""
    return (env.feet.contact != env.gait.clock.swings()).float().mean(dim=-1)


def stand(env: World) -> torch.Tensor:
    """1 while the gait clock rests."""
    return (~env.gait.clock.stepping).float()


def follow_stride(env: World, sharpness: float) -> torch.Tensor:
    """exp(-sharpness x sum of squares) of how far hips, knees and ankles are off the reference
    [1/rad^2].
    """
    return torch.exp(-sharpness * _off(env, env.gait.pitch_columns))


def leg_deviation(env: World) -> torch.Tensor:
    """Sum of squares of how far hips, knees and ankles are off the reference [rad^2]."""
    return _off(env, env.gait.pitch_columns)


def sideways_deviation(env: World) -> torch.Tensor:
    """The same of the legs' other joints, which roll and turn them."""
    return _off(env, env.gait.sideways_columns)


def upper_deviation(env: World) -> torch.Tensor:
    """The same of trunk and arms."""
    return _off(env, env.gait.upper_columns)


def foot_slip(env: World) -> torch.Tensor:
    """Sum of the squared planar speeds of the feet that touch [m^2/s^2], at most 4."""
    speed = env.gait.foot_vel[..., :2].square().sum(dim=-1)
    return (speed * env.feet.contact).sum(dim=-1).clamp_max(4.0)


def close_feet(env: World, distance: float) -> torch.Tensor:
    """How much nearer to each other than ``distance`` the feet are on the ground [m]."""
    apart = (env.gait.foot_pos[:, 0] - env.gait.foot_pos[:, 1])[:, :2]
    return (distance - torch.linalg.vector_norm(apart, dim=-1)).clamp_min(0.0)


def _off(env: World, columns: list[int]) -> torch.Tensor:
    return (env.state.joint_pos - env.gait.joint_pos)[:, columns].square().sum(dim=-1)


@dataclass(frozen=True)
class Registered:
    """A reward function, the type of command it reads (None: any), and whether it reads a gait."""

    function: Callable[..., torch.Tensor]
    needs: str | None = None
    gait: bool = False


REWARDS: dict[str, Registered] = {
    "track_planar_velocity": Registered(track_planar_velocity, "velocity"),
    "track_yaw_rate": Registered(track_yaw_rate, "velocity"),
    "track_heading": Registered(track_heading, "heading"),
    "reach": Registered(reach, "target"),
    "progress": Registered(progress, "target"),
    "approach": Registered(approach, "target"),
    "lift": Registered(lift, "target"),
    "hold_height": Registered(hold_height, "height"),
    "joint_speed": Registered(joint_speed),
    "joint_torque": Registered(joint_torque),
    "action_change": Registered(action_change),
    "joint_acceleration": Registered(joint_acceleration),
    "tilt": Registered(tilt),
    "vertical_motion": Registered(vertical_motion),
    "posture": Registered(posture),
    "alive": Registered(alive),
    "planar_speed": Registered(planar_speed),
    "displacement": Registered(displacement),
    "track_mean_planar_velocity": Registered(track_mean_planar_velocity, "velocity", gait=True),
    "track_mean_yaw_rate": Registered(track_mean_yaw_rate, "velocity", gait=True),
    "contact_schedule": Registered(contact_schedule, gait=True),
    "stand": Registered(stand, gait=True),
    "follow_stride": Registered(follow_stride, gait=True),
    "leg_deviation": Registered(leg_deviation, gait=True),
    "sideways_deviation": Registered(sideways_deviation, gait=True),
    "upper_deviation": Registered(upper_deviation, gait=True),
    "foot_slip": Registered(foot_slip, gait=True),
    "close_feet": Registered(close_feet, gait=True),
}


def parameters_of(name: str) -> dict[str, float | None]:
    """Parameters of a reward term, all above 0, -> their default; None where a value must be
    given.
    """
    arguments = list(inspect.signature(REWARDS[name].function).parameters.values())[1:]
    return {
        argument.name: None if argument.default is argument.empty else argument.default
        for argument in arguments
    }
