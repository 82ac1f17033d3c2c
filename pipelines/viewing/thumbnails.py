"""Small pictures of the robot in some poses."""

from __future__ import annotations

from collections.abc import Sequence

import mujoco
import numpy as np

from lacoloco.pipelines.viewing.camera import LOOKED_AT, Look, free_camera, needed_distance
from lacoloco.pipelines.viewing.drawn_scene import scene_model
from lacoloco.pipelines.viewing.extent import corners_of, standing_extent
from lacoloco.pipelines.viewing.offscreen import Painter
from lacoloco.robots.spec import RobotSpec

LOOK = Look(width=300, height=140, distance=1.0)
"""Pixels, and how near the camera comes at most, in sizes of the robot. It never turns: headings
show.
"""


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
    points = [np.array([*pose[:2], LOOKED_AT * extent.top]) for pose in poses]
    camera.distance = max(look.distance * extent.size, _distance(spec, poses, points, look))
    pictures = []
    with Painter(model, look.width, look.height) as painter:
        for pose, point in zip(poses, points, strict=True):
            data.qpos[:] = pose
            mujoco.mj_kinematics(model, data)
            mujoco.mj_camlight(model, data)
            camera.lookat[:] = point
            pictures.append(painter.draw(data, camera))
    return np.stack(pictures)


def _distance(
    spec: RobotSpec, poses: np.ndarray, points: Sequence[np.ndarray], look: Look
) -> float:
    """From how far away the whole robot is in every picture, m: one, so that sizes compare."""
    model = spec.model()
    data = mujoco.MjData(model)
    return max(
        float(needed_distance(point, corners_of(model, data, pose), 0.0, look).max())
        for pose, point in zip(poses, points, strict=True)
    )
