from dataclasses import replace
from io import BytesIO

import numpy as np
import pytest
from PIL import Image

from lacoloco.pipelines.errors import StageError
from lacoloco.pipelines.viewing import opengl, render
from lacoloco.pipelines.viewing.recording import from_clip
from lacoloco.pipelines.viewing.render import Look, frame_indices, render_frames, render_gif

SMALL = Look(width=96, height=64, centiseconds=20)


@pytest.fixture
def gl():
    """Skips where there is no OpenGL without a screen."""
    try:
        opengl.check_gl()
    except StageError as error:
        pytest.skip(str(error))


@pytest.fixture
def recording(make_clips, solo12):
    """Two thirds of a second; the target is in front of where the robot starts."""
    clip = from_clip(make_clips(solo12, frames=33)[0])
    target = np.tile(clip.root_pos[0] + [0.1, 0.2, 0.1], (33, 1))
    return replace(clip, target=target)


def reddish(frame):
    """How many pixels are of the target's colour."""
    red, green, blue = np.moveaxis(frame.astype(int), -1, 0)
    return np.count_nonzero((red > 2 * green) & (red > 2 * blue))


def test_robot_and_target_are_seen(gl, solo12, recording):
    frames = render_frames(solo12, recording, SMALL)
    assert frames.shape == (4, 64, 96, 3)
    assert all(reddish(frame) > 3 for frame in frames)
    without = render_frames(solo12, replace(recording, target=None), SMALL)
    assert not any(reddish(frame) for frame in without)
    dark = np.count_nonzero(without[0].max(-1) < 90)
    assert dark > 50  # its base, feet and shadow
    sky_and_floor = without[0, :, 0]
    assert sky_and_floor.min() > 90


@pytest.mark.parametrize("offset", [0.0, 30.0])
def test_the_camera_follows_the_robot(gl, solo12, recording, offset):
    far = replace(recording, root_pos=recording.root_pos + [offset, 0, 0], target=None)
    here = replace(recording, target=None)
    frames = render_frames(solo12, far, SMALL).astype(int)
    # offset by whole squares of the floor: the picture is the same but for rounding
    assert np.abs(frames - render_frames(solo12, here, SMALL)).mean() < 3


def test_any_robot_can_be_drawn(gl, robot, make_clips):
    clip = from_clip(make_clips(robot, frames=20)[0])
    frames = render_frames(robot, clip, SMALL)
    assert all(np.count_nonzero(frame.max(-1) < 110) > 30 for frame in frames)


def test_the_gif_has_the_time_of_the_recording(gl, solo12, recording):
    image = Image.open(BytesIO(render_gif(solo12, recording, SMALL)))
    assert image.size == (96, 64)
    assert image.n_frames == 4
    assert image.info["duration"] == 200


def test_the_frames_are_the_nearest_in_time(recording):
    assert frame_indices(recording, Look(centiseconds=8)).tolist() == list(range(0, 33, 4))
    slow = replace(recording, fps=30.0)  # 2.4 frames of it per frame
    assert frame_indices(slow, Look(centiseconds=8))[:6].tolist() == [0, 2, 5, 7, 10, 12]
    assert frame_indices(recording.until(0.0), Look()).tolist() == [0]


def test_a_gif_that_is_too_large_gets_fewer_colours(solo12, recording, monkeypatch):
    tried = []

    def encode(frames, milliseconds, colours):
        tried.append(colours)
        return bytes(100 * colours)

    monkeypatch.setattr(render, "render_frames", lambda *_: np.zeros((1, 2, 2, 3), np.uint8))
    monkeypatch.setattr(render, "encode_gif", encode)
    monkeypatch.setattr(render, "LIMIT", 5000)
    assert len(render_gif(solo12, recording)) == 3200
    assert tried == [128, 64, 32]
    monkeypatch.setattr(render, "LIMIT", 1000)
    with pytest.raises(StageError, match="--set seconds="):
        render_gif(solo12, recording)


@pytest.mark.parametrize("wanted", ["egl", "osmesa"])
def test_without_opengl_it_is_said_what_to_install(monkeypatch, wanted):
    def missing():
        raise AttributeError("'NoneType' object has no attribute 'glGetError'")

    monkeypatch.setattr(opengl.platform, "system", lambda: "Linux")
    monkeypatch.setattr(opengl, "_context_class", missing)
    monkeypatch.setenv("MUJOCO_GL", wanted)
    with pytest.raises(StageError) as raised:
        opengl.check_gl()
    message = str(raised.value)
    assert "\n" not in message
    assert opengl.PACKAGES[wanted] in message
    assert f"MUJOCO_GL={wanted} does not work" in message
