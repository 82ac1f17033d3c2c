"""Which pose an imported robot stands in, and what of it touches there."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from lacoloco.robots.importing.kinematics import Leg, foot_points, pose_data
from lacoloco.robots.importing.standing import level_feet, ranges, solve_standing
from lacoloco.robots.importing.writing import Canonical, add_exclude

if TYPE_CHECKING:
    import mujoco

NAMES = ("default", "home", "stand", "standing", "init")
"""Keyframes that stand, by their usual names; else the first one is taken."""
LYING = 0.5
"""A keyframe that is lower than that, in heights of the solved pose, shows a robot that lies."""
DIGITS = 6
"""Of angles, rad."""


def keyframe_angles(published: mujoco.MjModel, bare: mujoco.MjModel) -> np.ndarray | None:
    """(J,) joint angles of the keyframe that stands, rad, or None without one.

    Args:
        published: The model with the keyframes.
        bare: The robot; its joints are those of ``published`` by name.
    """
    if published.nkey == 0:
        return None
    names = [published.key(k).name for k in range(published.nkey)]
    chosen = next((names.index(name) for name in NAMES if name in names), 0)
    qpos = published.key_qpos[chosen]
    joints = [published.joint(bare.joint(j).name) for j in range(1, bare.njnt)]
    angles = np.array([qpos[int(joint.qposadr[0])] for joint in joints])
    return np.clip(angles, *ranges(bare))


def standing_angles(
    bare: mujoco.MjModel, legs: list[Leg], known: np.ndarray | None
) -> tuple[np.ndarray, bool]:
    """(J,) the pose, rad, and whether it had to be solved: without a keyframe that stands."""
    angles = solve_standing(bare, legs)
    lies = known is None or _height(bare, legs, known) < LYING * _height(bare, legs, angles)
    if known is not None and not lies:
        angles = known
    levelled = level_feet(bare, legs, angles)
    lower, upper = ranges(bare)
    # rounded towards the middle of the range, never out of it
    return np.clip(np.round(levelled, DIGITS), lower, upper), lies


def _height(bare: mujoco.MjModel, legs: list[Leg], angles: np.ndarray) -> float:
    """Of the base over the middles of the feet, m."""
    return -float(foot_points(bare, pose_data(bare, angles), legs)[:, 2].mean())


def untouching(canonical: Canonical, model: mujoco.MjModel, feet: Sequence[str]) -> list[str]:
    """Tell bodies that touch each other in the standing pose not to; a line that says which.

    They would push each other apart from the first step on. Published shapes overlap where meshes
    or cables are simplified.
    """
    import mujoco

    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    mujoco.mj_kinematics(model, data)
    mujoco.mj_comPos(model, data)
    mujoco.mj_collision(model, data)
    pairs: dict[tuple[str, str], None] = {}
    for contact in data.contact:
        first, second = sorted(model.body(model.geom_bodyid[g]).name for g in contact.geom)
        pairs[first, second] = None
    for pair in pairs:
        add_exclude(canonical, *pair)
    told = ", ".join(f"{first} and {second}" for first, second in pairs)
    return [f"never collide, since they touch in the standing pose: {told}"] if pairs else []
