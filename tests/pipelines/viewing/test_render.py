from dataclasses import replace
from io import BytesIO

import numpy as np
import pytest
from PIL import Image

from lacoloco.pipelines.errors import StageError
from lacoloco.pipelines.viewing import opengl, render
from lacoloco.pipelines.viewing.camera import Look
from lacoloco.pipelines.viewing.recording import from_clip
from lacoloco.pipelines.viewing.render import at_rate, draw_frames, render_gif, render_mp4

SMALL = Look(width=96, height=64, fps=5.0)


def render_frames(spec, recording, look):
    return np.stack(list(draw_frames(spec, recording, look)))


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
    assert frames[0, -1].min() > 90  # the floor in front has its own colours, not the robot's


def test_the_gif_has_the_time_of_the_recording(gl, solo12, recording):
    image = Image.open(BytesIO(render_gif(solo12, recording, SMALL)))
    assert image.size == (96, 64)
    assert image.n_frames == 4
    assert image.info["duration"] == 200


def test_a_film_of_slow_motion_has_more_pictures(gl, solo12, recording):
    slow = replace(SMALL, speed=0.5)  # 0.64 s of it take 1.28 s
    image = Image.open(BytesIO(render_gif(solo12, recording, slow)))
    assert (image.n_frames, image.info["duration"]) == (7, 200)


def test_a_mp4_has_the_pictures_and_the_time_of_the_recording(gl, solo12, recording):
    av = pytest.importorskip("av")
    look = replace(SMALL, fps=10.0)
    film = av.open(BytesIO(render_mp4(solo12, recording, look)))
    shown = [frame.to_ndarray(format="rgb24") for frame in film.decode(video=0)]
    assert film.streams.video[0].average_rate == 10
    assert np.stack(shown).shape == (7, 64, 96, 3)
    drawn = render_frames(solo12, recording, look)
    # Its colours are stored for four pixels at a time.
    apart = np.abs(np.stack(shown).astype(int) - drawn).mean(axis=(1, 2, 3))
    assert apart.max() < 8.0, "of 255"
    blank = np.abs(drawn.astype(int) - drawn.mean()).mean()
    assert blank > 12.0, "a blank film would be told"


def test_a_camera_that_shows_the_target_goes_as_far_as_it_must(gl, solo12, recording):
    far = replace(recording, target=recording.root_pos + [3.0, 0.5, 0.0]).until(0.2)
    sizes = {}
    for camera in ("target", "fixed", "follow"):
        look = replace(SMALL, width=192, height=128, camera=camera)
        sizes[camera] = [reddish(frame) for frame in render_frames(solo12, far, look)]
    assert min(sizes["target"]) > 0 and min(sizes["fixed"]) > 0
    assert max(sizes["follow"]) == 0


def test_poses_are_blended_between_frames(recording):
    half = at_rate(recording, 2 * recording.fps)
    assert (half.frames, half.fps) == (65, 2 * recording.fps)
    between = 0.5 * (recording.joint_pos[3] + recording.joint_pos[4])
    np.testing.assert_allclose(half.joint_pos[7], between, atol=1e-6)
    np.testing.assert_allclose(half.root_pos[6], recording.root_pos[3], atol=1e-6)


def test_a_gif_that_is_too_large_gets_fewer_colours(solo12, recording, monkeypatch):
    tried = []

    def encode(frames, milliseconds, colours):
        tried.append(colours)
        return bytes(100 * colours)

    monkeypatch.setattr(render, "draw_frames", lambda *_: [np.zeros((2, 2, 3), np.uint8)])
    monkeypatch.setattr(render, "encode_gif", encode)
    monkeypatch.setattr(render, "LIMIT", 5000)
    assert len(render_gif(solo12, recording)) == 3200
    assert tried == [128, 64, 32]
    monkeypatch.setattr(render, "LIMIT", 1000)
    with pytest.raises(StageError, match="--set seconds=1"):
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


@pytest.mark.parametrize(
    ("installed", "asked", "taken"),
    [
        (["EGL", "OSMesa"], "", "egl"),
        (["OSMesa"], "", "osmesa"),
        (["EGL", "OSMesa"], "osmesa", "osmesa"),
        ([], "", "egl"),
    ],
)
def test_software_draws_where_only_it_is_installed(monkeypatch, installed, asked, taken):
    found = {name: f"lib{name}.so" for name in installed}
    monkeypatch.setattr(opengl, "find_library", found.get)
    monkeypatch.setenv("MUJOCO_GL", asked)
    assert opengl._wanted() == taken


def test_without_its_encoder_a_mp4_says_what_to_install(monkeypatch):
    from lacoloco.pipelines.viewing import mp4

    monkeypatch.setattr(mp4, "find_spec", lambda name: None)
    with pytest.raises(StageError, match=r"lacoloco\[video\].*\.gif"):
        mp4.encode_mp4([], 25.0)
