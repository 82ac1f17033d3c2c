"""Recordings as animated GIFs, drawn by MuJoCo without a screen.

The scene is the robot's own model with a floor, light and a ball at the target; nothing is
simulated, each frame is a pose of the recording.
"""

from __future__ import annotations

from dataclasses import dataclass

import mujoco
import numpy as np

from lacoloco.pipelines.errors import StageError
from lacoloco.pipelines.retargeting.filters import smooth
from lacoloco.pipelines.viewing.gif import encode_gif
from lacoloco.pipelines.viewing.offscreen import Painter
from lacoloco.pipelines.viewing.recording import Recording
from lacoloco.robots.spec import RobotSpec

LIMIT = 3_000_000
"""Bytes that a GIF may have: what web pages and mails still show without a click."""
COLOURS = (128, 64, 32, 16)
"""Sizes of the palette, tried until the file is small enough."""
LOOKED_AT = 0.7
"""Height of the point the camera looks at, in standing heights of the robot."""
SUN = np.array([0.0, 0.0, -9.5])
"""From where its light starts to the point the camera looks at, in standing heights of the robot.
Straight down: under slanting light, specks show on the floor where the shadow map ends."""
TARGET_RGBA = (1.0, 0.12, 0.2, 1.0)
TARGET_RADIUS = 0.095
"""In standing heights of the robot; larger than on the page, whose pictures are larger."""


@dataclass(frozen=True)
class Look:
    """How the pictures look.

    Attributes:
        width: Pixels.
        height: Pixels.
        centiseconds: Between two frames; a GIF counts time in hundredths of a second.
        azimuth: Where the camera looks, degrees from world x to y.
        elevation: Degrees above the horizon that it looks; negative: down.
        distance: From the camera to the point it looks at, in standing heights of the robot.
    """

    width: int = 360
    height: int = 240
    centiseconds: int = 8
    azimuth: float = 130.0
    elevation: float = -26.0
    distance: float = 3.8


def render_gif(spec: RobotSpec, recording: Recording, look: Look | None = None) -> bytes:
    """Draw a recording as an animated GIF that repeats for ever.

    Args:
        spec: Its robot.
        recording: The whole of it is drawn.
        look: How; default: small enough for a README.

    Raises:
        StageError: There is no OpenGL here, or the file would exceed 3 MB.
    """
    look = look or Look()
    frames = render_frames(spec, recording, look)
    for colours in COLOURS:
        file = encode_gif(frames, 10 * look.centiseconds, colours)
        if len(file) < LIMIT:
            return file
    raise StageError(
        f"the GIF of {recording.duration:.1f} s would have {len(file) / 1e6:.1f} MB, more than"
        f" {LIMIT / 1e6:.0f}; make it shorter with --set seconds={recording.duration / 2:.0f}"
    )


def render_frames(spec: RobotSpec, recording: Recording, look: Look) -> np.ndarray:
    """Draw a recording at the frame rate of the look.

    Returns:
        (N, height, width, 3) uint8, RGB.

    Raises:
        StageError: There is no OpenGL here, or the recording is damaged.
    """
    recording.validate(spec.num_joints)
    model = scene_model(spec, look, ball=recording.target is not None)
    data = mujoco.MjData(model)
    looked_at = smooth(recording.root_pos, 0.3 * recording.fps)
    looked_at[:, 2] = LOOKED_AT * spec.default_height()
    camera, sun = _camera(look, spec.default_height()), SUN * spec.default_height()
    pictures = []
    with Painter(model, look.width, look.height) as painter:
        for index in frame_indices(recording, look):
            _pose(data, recording, index)
            mujoco.mj_kinematics(model, data)
            mujoco.mj_camlight(model, data)
            camera.lookat[:] = looked_at[index]
            data.light_xpos[0] = looked_at[index] - sun  # its shadows reach only so far
            pictures.append(painter.draw(data, camera))
    return np.stack(pictures)


def frame_indices(recording: Recording, look: Look) -> np.ndarray:
    """Frames of the recording that are drawn, (N,): the nearest at each time of the GIF."""
    step = recording.fps * look.centiseconds / 100
    count = int((recording.frames - 1) / step + 1e-6) + 1
    return np.rint(np.arange(count) * step).astype(int)


def scene_model(spec: RobotSpec, look: Look, *, ball: bool) -> mujoco.MjModel:
    """The robot with a chequered floor, sky and light; with a ball, as mocap body 0, or without."""
    scene = mujoco.MjSpec.from_file(str(spec.mjcf))
    visual = scene.visual
    visual.global_.offwidth, visual.global_.offheight = look.width, look.height
    visual.headlight.ambient = [0.45, 0.45, 0.45]
    visual.headlight.diffuse = [0.25, 0.25, 0.25]
    visual.headlight.specular = [0.0, 0.0, 0.0]
    _add_sky(scene)
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


def _add_sky(scene: mujoco.MjSpec) -> None:
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
    )


def _camera(look: Look, height: float) -> mujoco.MjvCamera:
    camera = mujoco.MjvCamera()
    camera.type = mujoco.mjtCamera.mjCAMERA_FREE
    camera.azimuth, camera.elevation = look.azimuth, look.elevation
    camera.distance = look.distance * height
    return camera


def _pose(data: mujoco.MjData, recording: Recording, index: int) -> None:
    """Set the robot, and the ball where there is one."""
    data.qpos[:3] = recording.root_pos[index]
    data.qpos[3:7] = recording.root_quat[index]
    data.qpos[7:] = recording.joint_pos[index]
    if recording.target is not None:
        data.mocap_pos[0] = recording.target[index]
