from dataclasses import replace

import numpy as np
import pytest

from lacoloco.pipelines.errors import StageError
from lacoloco.pipelines.viewing.camera import Look, axes_of, views_of
from lacoloco.pipelines.viewing.extent import Extent
from lacoloco.pipelines.viewing.recording import Recording

HEIGHT = 0.24  # of the robot's base in standing, m
EXTENT = Extent(top=0.3, size=0.5)


@pytest.fixture
def walk():
    """4 s: 2 m along x; the target jumps after 2 s from 3 m ahead to 2 m aside."""
    frames = 101
    root = np.zeros((frames, 3))
    root[:, 0], root[:, 2] = np.linspace(0, 2, frames), HEIGHT
    target = np.where(np.arange(frames)[:, None] < 50, [3.0, 0.3, 0.1], [1.0, -2.0, 0.3])
    quat = np.tile([1.0, 0, 0, 0], (frames, 1))
    return Recording("walk", 25.0, root, quat, np.zeros((frames, 12)), target=target)


def in_the_picture(views, look, points):
    """Whether points (N, 3) are inside a picture that is 45 degrees high, frame by frame."""
    turn, tilt = np.radians(look.azimuth), np.radians(look.elevation)
    into = [np.cos(tilt) * np.cos(turn), np.cos(tilt) * np.sin(turn), np.sin(tilt)]
    offset = points - (views.point - views.distance[:, None] * np.array(into))
    depth = offset @ np.array(into)
    sideways = np.abs(offset @ np.cross(into, [0, 0, 1.0])) / np.cos(tilt)
    upwards = np.sqrt(np.maximum((offset**2).sum(-1) - depth**2 - sideways**2, 0))
    edge = np.tan(np.radians(22.5)) * depth
    return (depth > 0) & (upwards < edge) & (sideways < edge * look.width / look.height)


@pytest.mark.parametrize("camera", ["target", "fixed"])
@pytest.mark.parametrize(("azimuth", "elevation"), [(130, -26), (0, -5), (90, -89), (-45, 0)])
@pytest.mark.parametrize("size", [(640, 480), (240, 480)])
def test_robot_and_target_are_always_in_the_picture(walk, camera, azimuth, elevation, size):
    look = Look(*size, camera=camera, azimuth=azimuth, elevation=elevation)
    views = views_of(walk, look, EXTENT)
    assert in_the_picture(views, look, walk.root_pos).all()
    assert in_the_picture(views, look, walk.target).all()
    if camera == "fixed":
        assert np.ptp(views.point, axis=0).max() == np.ptp(views.distance) == 0


def test_the_camera_moves_smoothly_when_the_target_jumps(walk):
    views = views_of(walk, Look(), EXTENT)
    assert np.abs(np.diff(views.distance)).max() * walk.fps < 3  # m/s
    assert np.abs(np.diff(views.point, axis=0)).max() * walk.fps < 2


def test_a_camera_that_follows_keeps_its_distance_and_shows_the_robot(walk):
    look = Look(camera="follow")
    views = views_of(walk, look, EXTENT)
    np.testing.assert_allclose(views.distance, look.distance * EXTENT.size)
    assert in_the_picture(views, look, walk.root_pos).all()
    assert not in_the_picture(views, look, walk.target).all()
    alone = views_of(replace(walk, target=None), Look(camera="target"), EXTENT)
    np.testing.assert_allclose(alone.point, views.point)


def test_axes_are_those_of_the_world():
    right, up, into = axes_of(Look(azimuth=90, elevation=0))
    np.testing.assert_allclose([right, up, into], [[1, 0, 0], [0, 0, 1], [0, 1, 0]], atol=1e-12)


def test_an_unknown_camera_is_refused(walk):
    with pytest.raises(StageError, match="target, follow or fixed"):
        views_of(walk, Look(camera="drone"), EXTENT)
