"""The pose in which an imported robot stands: from a keyframe, or solved."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from lacoloco.robots.importing.kinematics import Leg, foot_points, pose_data

if TYPE_CHECKING:
    import mujoco

STRETCHED = {"quadruped": 0.85, "biped": 0.97}
"""How far a leg is stretched that stands: hip to foot, as a share of its length."""
BEND = 0.5
"""Angle from which the solution for a leg starts, rad."""
LEVEL = 1e-5
"""Feet may differ in height by that much, m."""
BALANCING = 4
"""Times that two feet are moved to where the centre of mass is: it moves with the legs."""
STEPS = 200
DAMPING = 1e-4
FLAT_FEET = 5
"""A leg of so many hinges or more can keep its foot flat, too."""


def neutral_angles(model: mujoco.MjModel) -> np.ndarray:
    """(J,) zero, or what a range allows that is nearest to it, rad."""
    lower, upper = ranges(model)
    return np.clip(0.0, lower, upper)


def ranges(model: mujoco.MjModel) -> tuple[np.ndarray, np.ndarray]:
    """(J,) each, rad; infinite where a hinge turns freely."""
    limited = model.jnt_limited[1:].astype(bool)
    lower = np.where(limited, model.jnt_range[1:, 0], -np.inf)
    upper = np.where(limited, model.jnt_range[1:, 1], np.inf)
    return lower, upper


def solve_standing(model: mujoco.MjModel, legs: list[Leg]) -> np.ndarray:
    """(J,) legs bent under the hips, everything else at zero, rad.

    A leg of a quadruped bends so that its knee is behind hip and foot, one of a biped so that it
    is ahead, if its ranges allow both. Two feet stand under the centre of mass: else the robot
    tips over however stiff it is.
    """
    angles, ahead = _legs_under_hips(model, legs, 0.0), 0.0
    for _ in range(BALANCING if len(legs) == 2 else 0):
        data = pose_data(model, angles)
        ahead += float(data.subtree_com[1, 0] - foot_points(model, data, legs)[:, 0].mean())
        angles = _legs_under_hips(model, legs, ahead)
    return angles


def _legs_under_hips(model: mujoco.MjModel, legs: list[Leg], ahead: float) -> np.ndarray:
    """The same, the feet so far ahead of the hips, m."""
    kind = "biped" if len(legs) == 2 else "quadruped"
    straight = pose_data(model, np.zeros(model.nq - 7))
    angles = neutral_angles(model)
    for leg in legs:
        length = _length(model, straight, leg)
        hip = straight.xanchor[leg.pitches[0]] if leg.pitches else leg.hip
        foot = foot_points(model, straight, [leg])[0]
        target = np.array([hip[0] + ahead, foot[1], hip[2] - STRETCHED[kind] * length])
        flat = (
            straight.xmat[leg.limb.end].reshape(3, 3) if len(leg.limb.joints) >= FLAT_FEET else None
        )
        tries = [_solve_leg(model, angles, leg, target, flat, sign * BEND) for sign in (1.0, -1.0)]
        forward = 1.0 if kind == "biped" else -1.0
        best = min(tries, key=lambda found: (round(found[1], 4), -forward * found[2]))
        angles = best[0]
    return angles


def level_feet(model: mujoco.MjModel, legs: list[Leg], angles: np.ndarray) -> np.ndarray:
    """The pose with all feet at one height: that of their mean, where they differ."""
    data = pose_data(model, angles)
    points = foot_points(model, data, legs)
    bottoms = points[:, 2] - [leg.radius for leg in legs]
    if np.ptp(bottoms) <= LEVEL:
        return angles
    for leg, point, bottom in zip(legs, points, bottoms, strict=True):
        target = point + (0.0, 0.0, float(np.mean(bottoms)) - bottom)
        flat = data.xmat[leg.limb.end].reshape(3, 3) if len(leg.limb.joints) >= FLAT_FEET else None
        angles = _descend(model, angles, leg, target, flat)
    return angles


def _solve_leg(
    model: mujoco.MjModel,
    angles: np.ndarray,
    leg: Leg,
    target: np.ndarray,
    flat: np.ndarray | None,
    bend: float,
) -> tuple[np.ndarray, float, float]:
    """From one way of bending: the pose, its distance [m], and how far the knee is ahead [m]."""
    start = angles.copy()
    lower, upper = ranges(model)
    for number, joint in enumerate(leg.pitches[:2]):
        sign = float(np.sign(pose_data(model, angles).xaxis[joint, 1]))
        start[joint - 1] = sign * bend * (1.0, -2.0)[number]
    start = np.clip(start, lower, upper)
    found = _descend(model, start, leg, target, flat)
    data = pose_data(model, found)
    foot = foot_points(model, data, [leg])[0]
    knee = data.xanchor[leg.knee] if leg.knee >= 0 else foot
    between = 0.5 * (foot[0] + data.xanchor[leg.limb.joints[0], 0])
    return found, float(np.linalg.norm(foot - target)), float(knee[0] - between)


def _descend(
    model: mujoco.MjModel,
    angles: np.ndarray,
    leg: Leg,
    target: np.ndarray,
    flat: np.ndarray | None,
) -> np.ndarray:
    """Damped Gauss-Newton on the angles of one leg, within their ranges."""
    import mujoco

    angles, columns = angles.copy(), np.array(leg.limb.joints)
    lower, upper = ranges(model)
    linear, angular = np.zeros((3, model.nv)), np.zeros((3, model.nv))
    for _ in range(STEPS):
        data = pose_data(model, angles)
        point = foot_points(model, data, [leg])[0]
        mujoco.mj_jac(model, data, linear, angular, point, leg.limb.end)
        error, jacobian = target - point, linear[:, columns + 5]
        if flat is not None:
            turn = flat @ data.xmat[leg.limb.end].reshape(3, 3).T
            axis = 0.5 * np.array(
                [turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1]]
            )
            error = np.concatenate([error, axis])
            jacobian = np.concatenate([jacobian, angular[:, columns + 5]])
        normal = jacobian.T @ jacobian + DAMPING * np.eye(len(columns))
        step = np.linalg.solve(normal, jacobian.T @ error)
        angles[columns - 1] = np.clip(
            angles[columns - 1] + step.clip(-0.2, 0.2), lower[columns - 1], upper[columns - 1]
        )
        if np.abs(step).max() < 1e-12:
            break
    return angles


def _length(model: mujoco.MjModel, straight: mujoco.MjData, leg: Leg) -> float:
    """From the first hinge that bends the leg over the others to the foot, sideways apart, m."""
    points = [straight.xanchor[joint] for joint in leg.pitches]
    points.append(foot_points(model, straight, [leg])[0])
    flat = np.array(points)[:, [0, 2]]
    return float(np.linalg.norm(np.diff(flat, axis=0), axis=1).sum())
