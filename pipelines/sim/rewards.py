"""Reward terms: environment after a step -> (N,) reward per control step. Tasks list them by name
with a weight.
"""

from __future__ import annotations

from collections.abc import Callable

import torch

from lacoloco.pipelines.sim.physics import CONTROL_DT
from lacoloco.pipelines.sim.world import World


def track_planar_velocity(env: World) -> torch.Tensor:
    """exp(-|v_xy - v_xy*|^2 / 0.25), base frame (facts 2.3)."""
    error = env.state.lin_vel_b[:, :2] - env.command[:, :2]
    return torch.exp(-error.square().sum(dim=-1) / 0.25)


def track_planar_velocity_closely(env: World) -> torch.Tensor:
    """exp(-|v_xy - v_xy*|^2 / 0.02): the wide kernel alone is content with 0.2 m/s of error."""
    error = env.state.lin_vel_b[:, :2] - env.command[:, :2]
    return torch.exp(-error.square().sum(dim=-1) / 0.02)


def track_yaw_rate(env: World) -> torch.Tensor:
    """exp(-(w_z - w_z*)^2 / 0.25) (facts 2.3)."""
    return torch.exp(-(env.state.ang_vel_b[:, 2] - env.command[:, 2]).square() / 0.25)


def reach(env: World) -> torch.Tensor:
    """exp(-10 |p_ee - p*|), the paper's task reward."""
    return torch.exp(-10.0 * env.target_error())


def progress(env: World) -> torch.Tensor:
    """Speed at which the end effector approaches its target [m/s]: potential-based shaping with the
    distance.

    exp(-10 d) is 1e-6 at the distance where an episode starts, far below what a critic can resolve.
    """
    return (env.previous_target_error - env.target_error()) / CONTROL_DT


def approach(env: World) -> torch.Tensor:
    """exp(-|p_ee - p*| / 0.3): a wide slope for the expert, which starts far from its targets
    (facts 2.5 have 0.8).
    """
    return torch.exp(-env.target_error() / 0.3)


def lift(env: World) -> torch.Tensor:
    """exp(-|z_ee - z*| / 0.1): pays for height alone, so that the foot leaves the ground before it
    finds its target.
    """
    return torch.exp(-(env.end_effector()[:, 2] - env.command[:, 2]).abs() / 0.1)


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


REWARDS: dict[str, Callable[[World], torch.Tensor]] = {
    function.__name__: function
    for function in (
        track_planar_velocity,
        track_planar_velocity_closely,
        track_yaw_rate,
        reach,
        progress,
        approach,
        lift,
        joint_speed,
        joint_torque,
        action_change,
        joint_acceleration,
        tilt,
        vertical_motion,
        posture,
    )
}
