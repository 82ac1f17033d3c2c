"""Where the camera of a picture stands, frame by frame."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Literal

import mujoco
import numpy as np

from lacoloco.datasets.config_values import Within
from lacoloco.pipelines.errors import StageError
from lacoloco.pipelines.retargeting.filters import lower_envelope, smooth
from lacoloco.pipelines.viewing.extent import Extent
from lacoloco.pipelines.viewing.recording import Recording

Way = Literal["target", "follow", "fixed"]

LOOKED_AT = 0.6
"""Height of the point the camera looks at, in heights of the robot."""
OPENING = 45.0
"""Degrees that the picture is high: the free camera's of MuJoCo."""
INSIDE = 0.86
"""What must be seen keeps to this share of the picture."""
BODY = 0.6
"""How far a robot reaches around the point the camera looks at, in its sizes."""
STEADY = 1.0
"""Seconds over which a camera that shows robot and target moves."""


@dataclass(frozen=True)
class Look:
    """How pictures of a recording look.

    Attributes:
        width: Pixels.
        height: Pixels.
        fps: Pictures in a second of the film.
        speed: Seconds of the recording in a second of the film.
        camera: "follow": beside the robot. "target": the same, and so far away that the target is
            in the picture. "fixed": it stands still and sees the whole way.
        azimuth: Where the camera looks, degrees from world x to y.
        elevation: Degrees above the horizon that it looks; negative: down.
        distance: From the camera to the point it looks at, in sizes of the robot; more where what
            must be seen asks for it.
    """

    width: Annotated[int, Within(16, 4096)] = 360
    height: Annotated[int, Within(16, 4096)] = 240
    fps: Annotated[float, Within(1.0, 100.0)] = 12.5
    speed: Annotated[float, Within(0.05, 20.0)] = 1.0
    camera: Way = "target"
    azimuth: Annotated[float, Within(-360.0, 360.0)] = 130.0
    elevation: Annotated[float, Within(-89.0, 0.0)] = -26.0
    distance: Annotated[float, Within(0.5, 100.0)] = 2.3


@dataclass(frozen=True)
class Views:
    """What a camera looks at in each of N frames, (N, 3), and from how far away, (N,); m."""

    point: np.ndarray
    distance: np.ndarray


def free_camera(look: Look) -> mujoco.MjvCamera:
    """A camera that looks in the direction of `look`; the rest is set frame by frame."""
    camera = mujoco.MjvCamera()
    camera.type = mujoco.mjtCamera.mjCAMERA_FREE
    camera.azimuth, camera.elevation = look.azimuth, look.elevation
    return camera


def views_of(recording: Recording, look: Look, extent: Extent) -> Views:
    """Where the camera is in each frame of a recording.

    Args:
        recording: N frames.
        look: How.
        extent: Of the robot.

    Raises:
        StageError: A camera that is not known.
    """
    robot = smooth(recording.root_pos, 0.3 * recording.fps).copy()
    robot[:, 2] = LOOKED_AT * extent.top
    near = np.full(len(robot), look.distance * extent.size)
    if look.camera == "follow" or (look.camera == "target" and recording.target is None):
        return Views(robot, near)
    target = robot if recording.target is None else recording.target
    if look.camera == "target":
        point = smooth(0.5 * (robot + target), STEADY * recording.fps)
        far = np.maximum(needed_distance(point, robot, BODY * extent.size, look), near)
        far = np.maximum(needed_distance(point, target, 0.0, look), far)
        return Views(point, _steady(far, recording.fps))
    if look.camera == "fixed":
        both = np.concatenate([robot, target])
        point = np.broadcast_to(0.5 * (both.min(0) + both.max(0)), robot.shape)
        far = np.maximum(needed_distance(point, robot, BODY * extent.size, look), near)
        far = np.maximum(needed_distance(point, target, 0.0, look), far)
        return Views(point, np.full(len(robot), far.max()))
    raise StageError(f"camera '{look.camera}': use target, follow or fixed")


def axes_of(look: Look) -> np.ndarray:
    """Rows (3, 3): to the right, up and into the picture, in world axes."""
    turn, tilt = np.radians([look.azimuth, look.elevation])
    into = np.array([np.cos(tilt) * np.cos(turn), np.cos(tilt) * np.sin(turn), np.sin(tilt)])
    right = np.array([np.sin(turn), -np.cos(turn), 0.0])
    return np.stack([right, np.cross(right, into), into])


def needed_distance(point: np.ndarray, seen: np.ndarray, radius: float, look: Look) -> np.ndarray:
    """Distances (N,) at which balls of a radius around `seen` (N, 3) are in the picture, m."""
    right, up, into = axes_of(look)
    offset = seen - point
    high = INSIDE * np.tan(np.radians(OPENING / 2))
    wide = high * look.width / look.height
    across = (np.abs(offset @ right) + radius) / wide
    along = (np.abs(offset @ up) + radius) / high
    return np.maximum(across, along) - offset @ into + radius


def _steady(far: np.ndarray, fps: float) -> np.ndarray:
    """Distances that change slowly and are nowhere less than `far` (N,)."""
    return -lower_envelope(-far, max(1, round(STEADY * fps)))
