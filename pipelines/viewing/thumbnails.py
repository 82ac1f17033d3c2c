"""Small pictures of the robot in some poses."""

from __future__ import annotations

import mujoco
import numpy as np

from lacoloco.pipelines.viewing.camera import LOOKED_AT, Look, free_camera
from lacoloco.pipelines.viewing.drawn_scene import scene_model
from lacoloco.pipelines.viewing.extent import standing_extent
from lacoloco.pipelines.viewing.offscreen import Painter
from lacoloco.robots.spec import RobotSpec

LOOK = Look(width=300, height=140, distance=1.6)
"""Pixels, and how far away in sizes of the robot. The camera never turns: headings show."""


def draw_poses(spec: RobotSpec, poses: np.ndarray, look: Look = LOOK) -> np.ndarray:
    """Draw a robot on the floor, in the middle of each picture.

    Args:
        spec: The robot.
        poses: (n, 7 + J) position [m], quaternion wxyz, joints [rad].
        look: Size and direction of the pictures.

    Returns:
        (n, height, width, 3) uint8 RGB.

    Raises:
        StageError: There is no OpenGL here; the message says how to get it.
    """
    model = scene_model(spec, look.width, look.height, ball=False)
    data, camera, extent = mujoco.MjData(model), free_camera(look), standing_extent(spec)
    camera.distance = look.distance * extent.size
    pictures = []
    with Painter(model, look.width, look.height) as painter:
        for pose in poses:
            data.qpos[:] = pose
            mujoco.mj_kinematics(model, data)
            mujoco.mj_camlight(model, data)
            camera.lookat[:] = (*pose[:2], LOOKED_AT * extent.top)
            pictures.append(painter.draw(data, camera))
    return np.stack(pictures)
