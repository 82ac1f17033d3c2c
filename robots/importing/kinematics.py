"""What of a robot are its legs, found from how its bodies hang together in one pose."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from lacoloco.robots.errors import RobotError
from lacoloco.robots.geometry import lowest_point

if TYPE_CHECKING:
    import mujoco

NEAR_FLOOR = 0.1
"""A limb ends in a foot if it comes as near to the floor, in heights of the base."""
SAME_FLOOR = 0.02
"""Shapes of that limb that are as near to its lowest point belong to the foot."""
FOOT_HEIGHT = 0.15
"""But not rods: their middle is higher over it than that, in heights of the base."""
ALONG = 0.9
"""Cosine from which an axis counts as one of the base."""


@dataclass(frozen=True)
class Limb:
    """A chain of hinges from the base to the last body that moves.

    Attributes:
        end: Id of that body.
        joints: Ids of the hinges, from the base on, that belong to this limb alone.
        geoms: Ids of what collides on the last body and what is welded to it.
        lowest: Height of their lowest point, m.
    """

    end: int
    joints: tuple[int, ...]
    geoms: tuple[int, ...]
    lowest: float


@dataclass(frozen=True)
class Leg:
    """A limb that stands.

    Attributes:
        limb: It.
        geoms: Ids of the shapes of the foot.
        centre: Middle of the foot in the frame of the last body, m.
        radius: From the middle down to the floor, m.
        hip: World position of its first hinge in the pose, m.
        abduction: Hinge that moves it sideways, or -1.
        pitches: Hinges about the base's y axis, from the hip on.
    """

    limb: Limb
    geoms: tuple[int, ...]
    centre: np.ndarray
    radius: float
    hip: np.ndarray
    abduction: int
    pitches: tuple[int, ...]

    @property
    def knee(self) -> int:
        """The second hinge that bends it, or -1."""
        return self.pitches[1] if len(self.pitches) > 1 else -1


def pose_data(model: mujoco.MjModel, angles: np.ndarray) -> mujoco.MjData:
    """Kinematics with the base upright at the origin and joints (J,) at ``angles``, rad."""
    import mujoco

    data = mujoco.MjData(model)
    data.qpos[:7] = (0, 0, 0, 1, 0, 0, 0)
    data.qpos[7:] = angles
    mujoco.mj_kinematics(model, data)
    mujoco.mj_comPos(model, data)
    return data


def find_limbs(model: mujoco.MjModel, data: mujoco.MjData) -> list[Limb]:
    """Every chain of hinges that ends."""
    moving = [b for b in range(2, model.nbody) if model.body_jntnum[b]]
    inner = {_joint_parent(model, b) for b in moving}
    ends = [b for b in moving if b not in inner]
    paths = {end: _path(model, end) for end in ends}
    shared = {
        joint for joint in range(1, model.njnt) if sum(joint in path for path in paths.values()) > 1
    }
    limbs = []
    for end in ends:
        geoms = tuple(
            g
            for g in range(model.ngeom)
            if model.body_weldid[model.geom_bodyid[g]] == end
            and (model.geom_contype[g] or model.geom_conaffinity[g])
        )
        lowest = min((lowest_point(model, data, g) for g in geoms), default=float("inf"))
        own = tuple(joint for joint in paths[end] if joint not in shared)
        limbs.append(Limb(end, own, geoms, lowest))
    return limbs


def find_legs(model: mujoco.MjModel, data: mujoco.MjData, limbs: list[Limb]) -> list[Leg]:
    """The limbs that reach the floor, the base standing upright.

    Raises:
        RobotError: Fewer than two do.
    """
    floor = min((limb.lowest for limb in limbs), default=float("inf"))
    if not np.isfinite(floor):
        raise RobotError(
            "nothing at the end of its limbs can touch the floor; give the feet a collision shape"
        )
    height = max(float(data.xpos[1, 2]) - floor, 1e-6)
    low = [limb for limb in limbs if limb.lowest <= floor + NEAR_FLOOR * height]
    if len(low) < 2:
        raise RobotError(
            "only one limb reaches the floor; expected two feet or more (with the base's z axis"
            " pointing up)"
        )
    return [_leg(model, data, limb, height) for limb in low]


def _leg(model: mujoco.MjModel, data: mujoco.MjData, limb: Limb, height: float) -> Leg:
    lows = {g: lowest_point(model, data, g) for g in limb.geoms}
    geoms = tuple(g for g in limb.geoms if lows[g] <= limb.lowest + SAME_FLOOR * height)
    highest = limb.lowest + FOOT_HEIGHT * height
    geoms = tuple(g for g in geoms if data.geom_xpos[g, 2] <= highest) or geoms
    middle = np.mean([data.geom_xpos[g] for g in geoms], axis=0)
    rotation = data.xmat[limb.end].reshape(3, 3)
    sideways = [j for j in limb.joints if abs(data.xaxis[j, 0]) > ALONG]
    return Leg(
        limb=limb,
        geoms=geoms,
        centre=rotation.T @ (middle - data.xpos[limb.end]),
        radius=float(middle[2] - limb.lowest),
        hip=data.xanchor[limb.joints[0]].copy(),
        abduction=sideways[0] if sideways else -1,
        pitches=tuple(j for j in limb.joints if abs(data.xaxis[j, 1]) > ALONG),
    )


def foot_points(model: mujoco.MjModel, data: mujoco.MjData, legs: list[Leg]) -> np.ndarray:
    """World positions of the middles of the feet, (F, 3), m."""
    points = [
        data.xpos[leg.limb.end] + data.xmat[leg.limb.end].reshape(3, 3) @ leg.centre for leg in legs
    ]
    return np.array(points)


def sides(points: Mapping[str, np.ndarray]) -> dict[str, str]:
    """Left and right, hind and fore of four feet: ``FL``, ``FR``, ``HL``, ``HR`` -> the name.

    Returns:
        Empty for any other number of feet, or where two are on the same corner.
    """
    middle = np.mean(list(points.values()), axis=0)
    corners = {
        ("F" if point[0] > middle[0] else "H") + ("L" if point[1] > middle[1] else "R"): name
        for name, point in points.items()
    }
    return corners if len(points) == 4 and len(corners) == 4 else {}


def _joint_parent(model: mujoco.MjModel, body: int) -> int:
    """The nearest body above that moves on a joint of its own."""
    return int(model.body_weldid[model.body_parentid[body]])


def _path(model: mujoco.MjModel, body: int) -> list[int]:
    joints: list[int] = []
    while model.body_parentid[body] != 0:
        if model.body_jntnum[body]:
            joints.insert(0, int(model.body_jntadr[body]))
        body = int(model.body_parentid[body])
    return joints
