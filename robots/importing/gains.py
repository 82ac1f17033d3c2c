"""Gains of the motors and how joints answer them, from inertia and torque."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from lacoloco.robots.importing.kinematics import Leg, foot_points, pose_data

if TYPE_CHECKING:
    import mujoco

FULL_TORQUE = 1.0
"""Deflection at which a motor gives all its torque, rad. Published gains of legged robots in
learning are between 0.7 and 1.5 (Solo12, A1, Go1, ANYmal, H1, G1)."""
SAG = 0.2
"""Deflection under the robot's own weight that a joint may have, rad, where that asks for more."""
STEADY = 2.0
"""Stiffness in those with which what a joint carries would just tip over."""
DAMPING_RATIO = 0.7
"""Of a leg that swings freely."""
LEAST_DAMPING = 0.1
"""Share of the damping that the controller gives, however much the joint has of its own."""
FREQUENCY = 5.0
"""Natural frequency of a joint whose torque is not known, Hz."""
CONTROL_STEP = 0.02
"""s"""
POSITION_WEIGHT = 2160.0
"""What a wrong angle counts against a wrong speed in finding actions of clips, 1/s2."""
REGULARISATION = 135.0
"""What an action counts against them, rad/s squared per rad squared."""


@dataclass(frozen=True)
class Gains:
    """(J,) each.

    Attributes:
        stiffness: N.m/rad.
        damping: N.m.s/rad, besides the joint's own.
        inertia: That the motor moves when the leg swings freely, kg.m2.
        load: Torque that holds the standing robot, N.m.
    """

    stiffness: np.ndarray
    damping: np.ndarray
    inertia: np.ndarray
    load: np.ndarray


def propose_gains(
    model: mujoco.MjModel,
    legs: list[Leg],
    angles: np.ndarray,
    efforts: np.ndarray,
    firmness: float = 1.0,
) -> Gains:
    """Gains for a pose.

    Stiffness: all the torque at one radian, or what keeps the deflection under the robot's own
    weight small, or twice what keeps upright what is above the joint. Damping: what the joint lacks
    of seven tenths of the critical one, base held.

    Args:
        model: The bare robot.
        legs: Its legs.
        angles: (J,) standing pose, rad.
        efforts: (J,) torque limits, N.m; 0: unknown.
        firmness: Factor on the stiffness of legs and waist, see :mod:`.firmness`.
    """
    import mujoco

    data = pose_data(model, angles)
    mujoco.mj_forward(model, data)
    full = np.zeros((model.nv, model.nv))
    mujoco.mj_fullM(model, data, full)
    inertia = np.diag(full)[6:].copy()
    load = np.abs(_load(model, data, legs))
    unknown = inertia * (2.0 * np.pi * FREQUENCY) ** 2
    stiffness = np.where(efforts > 0.0, efforts / FULL_TORQUE, unknown)
    stiffness = np.maximum(stiffness, load / SAG)
    toppling = _toppling(model, data, legs)
    stiffness = np.maximum(stiffness, STEADY * toppling)
    carrying = toppling > 0.0  # a torso that leans on its waist tips the robot, too
    carrying[[joint - 1 for leg in legs for joint in leg.limb.joints]] = True
    stiffness[carrying] *= firmness
    critical = 2.0 * np.sqrt(stiffness * inertia)
    own = model.dof_damping.reshape(model.nv, -1)[6:, 0]
    damping = np.maximum(DAMPING_RATIO * critical - own, LEAST_DAMPING * critical)
    return Gains(rounded(stiffness), rounded(damping), inertia, load)


def clip_gains(gains: Gains, own_damping: np.ndarray) -> tuple[float, float]:
    """Gains that find actions of clips, for a typical joint: on the angle, and on the speed [s].

    A joint that answers a changed target, within one control step, by a share a of it in position
    and by b [1/s] of it in speed is moved from (e, v) to rest by the action that least squares
    find: (p a e + b v) / (p a^2 + b^2 + r).
    """
    answers = [
        _answer(*row)
        for row in zip(gains.stiffness, gains.damping + own_damping, gains.inertia, strict=True)
    ]
    position, speed = np.median(np.array(answers), axis=0)
    whole = POSITION_WEIGHT * position**2 + speed**2 + REGULARISATION
    return float(POSITION_WEIGHT * position / whole), float(speed / whole)


def _answer(stiffness: float, damping: float, inertia: float) -> tuple[float, float]:
    """Angle and speed after one control step towards a target one radian away."""
    angle = speed = 0.0
    steps = 200
    for _ in range(steps):
        torque = stiffness * (1.0 - angle) - damping * speed
        # implicit in the damping, which may be stiff
        speed += CONTROL_STEP / steps * torque / (inertia + CONTROL_STEP / steps * damping)
        angle += CONTROL_STEP / steps * speed
    return angle, speed


def _load(model: mujoco.MjModel, data: mujoco.MjData, legs: list[Leg]) -> np.ndarray:
    """(J,) torque of gravity, each foot carrying an equal share of the weight, N.m."""
    import mujoco

    torque = data.qfrc_bias[6:].copy()
    weight = float(model.body_mass.sum() * np.linalg.norm(model.opt.gravity))
    linear = np.zeros((3, model.nv))
    for leg, point in zip(legs, foot_points(model, data, legs), strict=True):
        mujoco.mj_jac(model, data, linear, None, point, leg.limb.end)
        torque -= linear[2, 6:] * weight / len(legs)
    return torque


def _toppling(model: mujoco.MjModel, data: mujoco.MjData, legs: list[Leg]) -> np.ndarray:
    """(J,) stiffness below which what a joint carries tips over, N.m/rad: weight times height.

    An arm or the torso carries what comes after it, a leg its share of the whole robot. Nothing
    tips about an upright axis, nor what hangs.
    """
    gravity, whole = float(np.linalg.norm(model.opt.gravity)), float(model.body_mass.sum())
    standing = {joint for leg in legs for joint in leg.limb.joints}
    needed = np.zeros(model.njnt - 1)
    for joint in range(1, model.njnt):
        body = 1 if joint in standing else int(model.jnt_bodyid[joint])
        mass = whole / len(legs) if joint in standing else float(model.body_subtreemass[body])
        height = float(data.subtree_com[body, 2] - data.xanchor[joint, 2])
        level = 1.0 - float(data.xaxis[joint, 2]) ** 2
        needed[joint - 1] = level * mass * gravity * max(height, 0.0)
    return needed


def rounded(values: np.ndarray) -> np.ndarray:
    """To three digits."""
    return np.array([float(f"{value:.3g}") for value in values])
