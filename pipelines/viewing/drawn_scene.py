"""The world that MuJoCo draws: the robot's model with a floor, light and a ball at the target."""

from __future__ import annotations

import mujoco
import numpy as np

from lacoloco.robots.spec import RobotSpec

SUN = np.array([0.0, 0.0, -9.5])
"""From where its light starts to the robot, in standing heights of the robot.
Straight down: under slanting light, specks show on the floor where the shadow map ends."""
LAST_DRAWN_GROUP = 2
"""The last group of shapes that MuJoCo draws, unless it is told otherwise."""
TARGET_RGBA = (1.0, 0.12, 0.2, 1.0)
TARGET_RADIUS = 0.095
"""In standing heights of the robot; larger than on the page, whose pictures are larger."""


def scene_model(spec: RobotSpec, width: int, height: int, *, ball: bool) -> mujoco.MjModel:
    """The robot with a chequered floor, sky and light; with a ball, as mocap body 0, or without.

    Args:
        spec: The robot.
        width: Of the pictures, pixels.
        height: Of the pictures, pixels.
        ball: Whether there is a target.
    """
    scene = mujoco.MjSpec.from_file(str(spec.mjcf))
    visual = scene.visual
    visual.global_.offwidth, visual.global_.offheight = width, height
    visual.headlight.ambient = [0.45, 0.45, 0.45]
    visual.headlight.diffuse = [0.25, 0.25, 0.25]
    visual.headlight.specular = [0.0, 0.0, 0.0]
    add_sky(scene)
    _add_floor(scene)
    _add_sun(scene)
    if ball:
        target = scene.worldbody.add_body(name="target", mocap=True)
        sphere = mujoco.mjtGeom.mjGEOM_SPHERE
        target.add_geom(
            type=sphere, size=[TARGET_RADIUS * spec.default_height(), 0, 0], rgba=TARGET_RGBA
        )
    return scene.compile()


def _add_sun(scene: mujoco.MjSpec) -> None:
    """Light from above that casts shadows."""
    scene.visual.quality.shadowsize = 1024
    scene.worldbody.add_light(
        type=mujoco.mjtLightType.mjLIGHT_DIRECTIONAL,
        dir=SUN,
        diffuse=[0.55, 0.55, 0.55],
        specular=[0.1, 0.1, 0.1],
    )


def add_sky(scene: mujoco.MjSpec) -> None:
    """One plain colour: a gradient would cost colours of the palette, and bytes."""
    plain = [0.93, 0.95, 0.98]
    scene.add_texture(
        name="sky",
        type=mujoco.mjtTexture.mjTEXTURE_SKYBOX,
        builtin=mujoco.mjtBuiltin.mjBUILTIN_FLAT,
        rgb1=plain,
        rgb2=plain,
        width=16,
        height=96,
    )


def _add_floor(scene: mujoco.MjSpec) -> None:
    """Squares of half a metre: a moving floor needs a pattern to be seen to move."""
    scene.add_texture(
        name="squares",
        type=mujoco.mjtTexture.mjTEXTURE_2D,
        builtin=mujoco.mjtBuiltin.mjBUILTIN_CHECKER,
        rgb1=[0.72, 0.76, 0.80],
        rgb2=[0.84, 0.87, 0.90],
        width=256,
        height=256,
    )
    floor = scene.add_material(name="squares", texrepeat=[1, 1], texuniform=True)
    floor.textures[mujoco.mjtTextureRole.mjTEXROLE_RGB] = "squares"
    floor.specular = 0.0
    scene.worldbody.add_geom(
        name="floor",
        type=mujoco.mjtGeom.mjGEOM_PLANE,
        size=[0, 0, 1],
        material="squares",
        rgba=[0.8, 0.8, 0.8, 1.0],  # times the squares'; else the robot's default class tints them
    )
