"""How large a robot is in a picture."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product

import mujoco
import numpy as np

from lacoloco.robots.spec import RobotSpec


@dataclass(frozen=True)
class Extent:
    """Of a robot in its default pose, its feet on the floor.

    Attributes:
        top: Height of its highest point, m. Not that of its base: a humanoid is nearly twice as
            high as its pelvis.
        size: Its height or its length, whichever is more, m: how far away a camera must be.
    """

    top: float
    size: float


def standing_extent(spec: RobotSpec) -> Extent:
    """Measure a robot; of each geom the corners of its bounding box count."""
    model = spec.model()
    points = corners_of(model, mujoco.MjData(model), spec.default_qpos())
    top = float(points[:, 2].max())
    return Extent(top, max(top, float(np.ptp(points[:, :2], axis=0).max())))


def corners_of(model: mujoco.MjModel, data: mujoco.MjData, qpos: np.ndarray) -> np.ndarray:
    """(n, 3) corners of the bounding boxes of all geoms in a pose (7 + J,); world, m."""
    data.qpos[:] = qpos
    mujoco.mj_kinematics(model, data)
    corners = np.array(list(product((-1.0, 1.0), repeat=3)))
    boxes = model.geom_aabb[:, None, :3] + corners * model.geom_aabb[:, None, 3:]
    turned = np.einsum("gij,gcj->gci", data.geom_xmat.reshape(-1, 3, 3), boxes)
    points: np.ndarray = (data.geom_xpos[:, None] + turned).reshape(-1, 3)
    return points
