"""Recordings as films, GIF or MP4, drawn by MuJoCo without a screen.

Nothing is simulated: each picture is a pose of the recording, between two frames a blend of them.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import mujoco
import numpy as np

from lacoloco.datasets.series import resampled
from lacoloco.pipelines.errors import StageError
from lacoloco.pipelines.stage import SILENT, Progress
from lacoloco.pipelines.viewing.camera import Look, free_camera, views_of
from lacoloco.pipelines.viewing.drawn_scene import SUN, scene_model
from lacoloco.pipelines.viewing.extent import standing_extent
from lacoloco.pipelines.viewing.gif import encode_gif
from lacoloco.pipelines.viewing.mp4 import encode_mp4
from lacoloco.pipelines.viewing.offscreen import Painter
from lacoloco.pipelines.viewing.recording import Recording
from lacoloco.robots.spec import RobotSpec

LIMIT = 3_000_000
"""Bytes that a GIF may have: what web pages and mails still show without a click."""
COLOURS = (128, 64, 32, 16)
"""Sizes of the palette, tried until the file is small enough."""
GIF_LOOK, MP4_LOOK = Look(), Look(width=640, height=480, fps=25.0)
"""Of a file of each kind, unless it is said otherwise."""


def render_gif(
    spec: RobotSpec, recording: Recording, look: Look = GIF_LOOK, progress: Progress = SILENT
) -> bytes:
    """Draw a recording as an animated GIF that repeats for ever.

    Args:
        spec: Its robot.
        recording: The whole of it is drawn.
        look: How; a GIF counts time in hundredths of a second, and takes the nearest rate.
        progress: Is told how many pictures are drawn.

    Raises:
        StageError: There is no OpenGL here, or the file would exceed 3 MB.
    """
    centiseconds = max(2, round(100 / look.fps))
    look = replace(look, fps=100 / centiseconds)
    frames = np.stack(list(draw_frames(spec, recording, look, progress)))
    for colours in COLOURS:
        file = encode_gif(frames, 10 * centiseconds, colours)
        if len(file) < LIMIT:
            return file
    shorter = max(1, int(recording.duration / 2))
    raise StageError(
        f"the GIF of {recording.duration:.1f} s would have {len(file) / 1e6:.1f} MB, more than"
        f" {LIMIT / 1e6:.0f}; make it shorter with --set seconds={shorter}, or smaller with --size,"
        " or name an .mp4"
    )


def render_mp4(
    spec: RobotSpec, recording: Recording, look: Look = MP4_LOOK, progress: Progress = SILENT
) -> bytes:
    """Draw a recording as an MP4 (H.264).

    Args:
        spec: Its robot.
        recording: The whole of it is drawn.
        look: How; width and height are even.
        progress: Is told how many pictures are drawn.

    Raises:
        StageError: There is no OpenGL or no PyAV here.
    """
    return encode_mp4(draw_frames(spec, recording, look, progress), look.fps)


def draw_frames(
    spec: RobotSpec, recording: Recording, look: Look, progress: Progress = SILENT
) -> Iterator[np.ndarray]:
    """Draw the pictures of a film one after the other.

    Yields:
        (height, width, 3) uint8, RGB.

    Raises:
        StageError: There is no OpenGL here, or the recording is damaged.
    """
    recording.validate(spec.num_joints)
    recording = at_rate(recording, look.fps / look.speed)
    height = spec.default_height()
    model = scene_model(spec, look.width, look.height, ball=recording.target is not None)
    data, camera = mujoco.MjData(model), free_camera(look)
    views = views_of(recording, look, standing_extent(spec))
    progress.start("drawing", recording.frames)
    with Painter(model, look.width, look.height) as painter:
        for index in range(recording.frames):
            _pose(data, recording, index)
            mujoco.mj_kinematics(model, data)
            mujoco.mj_camlight(model, data)
            camera.lookat[:], camera.distance = views.point[index], views.distance[index]
            # its shadows reach only so far
            data.light_xpos[0] = recording.root_pos[index] - SUN * height
            yield painter.draw(data, camera)
            progress.advance(index + 1)
    progress.stop()


def at_rate(recording: Recording, fps: float) -> Recording:
    """Poses and target of a recording at another rate; whatever else it holds is left out."""
    names = ("root_pos", "root_quat", "joint_pos", "target")
    series = {name: getattr(recording, name) for name in names}
    known = {name: np.asarray(rows, float) for name, rows in series.items() if rows is not None}
    blended = resampled(known, recording.fps, fps)
    return Recording(
        name=recording.name,
        fps=fps,
        root_pos=blended["root_pos"],
        root_quat=blended["root_quat"],
        joint_pos=blended["joint_pos"],
        target=blended.get("target"),
        note=recording.note,
    )


def _pose(data: mujoco.MjData, recording: Recording, index: int) -> None:
    """Set the robot, and the ball where there is one."""
    data.qpos[:3] = recording.root_pos[index]
    data.qpos[3:7] = recording.root_quat[index]
    data.qpos[7:] = recording.joint_pos[index]
    if recording.target is not None:
        data.mocap_pos[0] = recording.target[index]
