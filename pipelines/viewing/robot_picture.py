"""A robot in one pose as a picture: left as it looks, right the shapes that touch."""

from __future__ import annotations

import io

import matplotlib.image
import mujoco
import numpy as np

from lacoloco.pipelines.viewing.drawn_scene import LAST_DRAWN_GROUP, add_sky
from lacoloco.pipelines.viewing.offscreen import Painter
from lacoloco.robots.scene import compile_scene
from lacoloco.robots.spec import RobotSpec

WIDTH, HEIGHT = 640, 560
"""Pixels of each half."""
AZIMUTH, ELEVATION = 145.0, -14.0
"""Where the camera looks, degrees: from ahead of the robot, from its right, from above."""
ROOM = 0.9
"""Of the ball around the robot's shapes, the share that has to be seen: no robot fills it."""
SHOWN, HIDDEN = 0, 5
"""One that it draws, and one that it does not."""


def draw_robot(spec: RobotSpec, qpos: np.ndarray) -> bytes:
    """Draw a robot on the floor.

    Args:
        spec: The robot.
        qpos: (7 + J,) its pose: position [m], quaternion wxyz, joints [rad].

    Returns:
        A PNG.

    Raises:
        StageError: There is no OpenGL here; the message says how to get it.
    """
    model = compile_scene(spec, visual=True, change=_set_size)
    data = mujoco.MjData(model)
    data.qpos[:] = qpos
    mujoco.mj_forward(model, data)
    touching = (model.geom_contype | model.geom_conaffinity) != 0
    floor = model.geom_type == mujoco.mjtGeom.mjGEOM_PLANE
    looks = model.geom_group <= LAST_DRAWN_GROUP
    camera = _camera(model, data, ~floor)
    halves = []
    with Painter(model, WIDTH, HEIGHT) as painter:
        for shown in (looks, touching):
            model.geom_group[:] = np.where(shown | floor, SHOWN, HIDDEN)
            halves.append(painter.draw(data, camera))
    file = io.BytesIO()
    matplotlib.image.imsave(file, np.ascontiguousarray(np.hstack(halves)), format="png")
    return file.getvalue()


def _set_size(scene: mujoco.MjSpec) -> None:
    scene.visual.global_.offwidth, scene.visual.global_.offheight = WIDTH, HEIGHT
    scene.visual.headlight.ambient = [0.4, 0.4, 0.4]
    add_sky(scene)


def _camera(model: mujoco.MjModel, data: mujoco.MjData, robot: np.ndarray) -> mujoco.MjvCamera:
    """One that sees the whole robot, at the middle of its shapes."""
    centres = data.geom_xpos[robot]
    lower, upper = centres.min(axis=0), centres.max(axis=0)
    lower[2] = 0.0  # what stands on the floor
    radius = float(np.linalg.norm(upper - lower)) / 2 + float(model.geom_rbound[robot].max())
    camera = mujoco.MjvCamera()
    camera.type = mujoco.mjtCamera.mjCAMERA_FREE
    camera.azimuth, camera.elevation = AZIMUTH, ELEVATION
    camera.lookat[:] = 0.5 * (lower + upper)
    camera.distance = ROOM * radius / np.sin(np.radians(0.5 * model.vis.global_.fovy))
    return camera
