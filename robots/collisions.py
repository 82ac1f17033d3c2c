"""What of a robot lies in the floor or in itself in a pose: every contact of the compiled model."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from lacoloco.robots.scene import compile_scene

if TYPE_CHECKING:
    import mujoco

    from lacoloco.robots.spec import RobotSpec


@dataclass(frozen=True)
class Penetrations:
    """Depths in T poses, m; 0 where nothing touches.

    Attributes:
        floor: (T,) deepest body in the floor that is no foot.
        own: (T,) deepest pair of the robot's own bodies, where the robot has self collisions.
        floor_bodies: which bodies that are.
        own_pairs: which pairs.
    """

    floor: np.ndarray
    own: np.ndarray
    floor_bodies: tuple[str, ...]
    own_pairs: tuple[str, ...]


def find_penetrations(robot: RobotSpec, qpos: np.ndarray, deeper_than: float) -> Penetrations:
    """Look for contacts in poses.

    Args:
        robot: The robot.
        qpos: (T, 7 + J) root position [m], quaternion wxyz, joints [rad].
        deeper_than: Depth [m] from which a body is named.
    """
    import mujoco

    model = compile_scene(robot)
    data = mujoco.MjData(model)
    floor, own = np.zeros(len(qpos)), np.zeros(len(qpos))
    bodies: dict[str, None] = {}
    pairs: dict[str, None] = {}
    for frame, pose in enumerate(qpos):
        data.qpos[:] = pose
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        mujoco.mj_collision(model, data)
        for names, depth in _depths(model, data):
            robots_own = [name for name in names if name != "world"]
            if len(robots_own) == 2:
                own[frame] = max(own[frame], depth)
                if depth > deeper_than:
                    pairs[" and ".join(sorted(robots_own))] = None
            elif robots_own[0] not in robot.feet:
                floor[frame] = max(floor[frame], depth)
                if depth > deeper_than:
                    bodies[robots_own[0]] = None
    return Penetrations(floor, own, tuple(bodies), tuple(pairs))


def _depths(model: mujoco.MjModel, data: mujoco.MjData) -> list[tuple[list[str], float]]:
    """Names of the two bodies of each contact, and its depth [m]."""
    return [
        ([model.body(model.geom_bodyid[geom]).name for geom in contact.geom], -float(contact.dist))
        for contact in data.contact
        if contact.dist < 0.0
    ]
