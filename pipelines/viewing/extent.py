"""How large a robot is in a picture."""

from __future__ import annotations

from itertools import product

import mujoco
import numpy as np

from lacoloco.robots.spec import RobotSpec


def standing_top(spec: RobotSpec) -> float:
    """Height of the highest point of the robot in the default pose, its feet on the floor, m.

    Not that of its base: a humanoid is nearly twice as high as its pelvis. Of each geom the corners
    of its bounding box count.
    """
    model = spec.model()
    data = mujoco.MjData(model)
    data.qpos[:] = spec.default_qpos()
    mujoco.mj_kinematics(model, data)
    corners = np.array(list(product((-1.0, 1.0), repeat=3)))
    boxes = model.geom_aabb[:, None, :3] + corners * model.geom_aabb[:, None, 3:]
    up = data.geom_xmat.reshape(-1, 3, 3)[:, 2]
    return float((data.geom_xpos[:, None, 2] + np.einsum("gci,gi->gc", boxes, up)).max())
