from dataclasses import replace

import numpy as np
import pytest

from lacoloco.datasets import rotations
from lacoloco.datasets.artifact import read_artifact, write_artifact
from lacoloco.datasets.clip import load_clips, save_clips
from lacoloco.datasets.errors import ArtifactError, DatasetError

SERIES = ("root_pos", "root_quat", "root_lin_vel_b", "root_ang_vel_b", "joint_pos", "joint_vel")


def test_velocities_of_a_circle_in_the_base_frame(make_clip):
    clip = make_clip(speed=0.5, fps=50, frames=100)
    inner = slice(1, -1)
    np.testing.assert_allclose(clip.root_lin_vel_b[inner], np.tile([0.5, 0, 0], (98, 1)), atol=1e-4)
    np.testing.assert_allclose(clip.root_ang_vel_b, np.tile([0, 0, 0.5], (100, 1)), atol=1e-9)
    time = np.arange(100) / 50
    expected = np.cos(time[inner, None] + np.arange(3))
    np.testing.assert_allclose(clip.joint_vel[inner], expected, atol=1e-4)


def test_flipped_quaternion_signs_change_nothing(make_clip):
    """-q is q: a retargeter that flips signs must not produce turns of thousands of rad/s."""
    clip = make_clip()
    flips = np.where(np.random.default_rng(0).random(clip.frames) < 0.5, -1.0, 1.0)[:, None]
    flipped = type(clip).from_poses(
        "flipped", clip.fps, clip.joint_names, clip.root_pos, clip.root_quat * flips, clip.joint_pos
    )
    np.testing.assert_allclose(flipped.root_ang_vel_b, clip.root_ang_vel_b, atol=1e-9)
    assert ((flipped.root_quat[1:] * flipped.root_quat[:-1]).sum(1) > 0).all()


def test_slice_and_duration(make_clip):
    clip = make_clip(frames=51, fps=50, contacts=np.eye(51, 4, dtype=bool))
    assert clip.duration == pytest.approx(1.0)
    part = clip.slice(10, 20)
    assert (part.frames, part.name) == (10, clip.name)
    for name in (*SERIES, "contacts"):
        np.testing.assert_array_equal(getattr(part, name), getattr(clip, name)[10:20])
    for start, stop in ((5, 5), (-1, 3), (0, 52), (30, 20)):
        with pytest.raises(DatasetError, match="within 0:51"):
            clip.slice(start, stop)


@pytest.mark.parametrize("fps", [20.0, 50.0, 60.0, 173.0])
def test_resampling_follows_the_motion(make_clip, fps):
    clip = make_clip(frames=101, fps=50, contacts=np.arange(101)[:, None] > 50)
    result = clip.resample(fps)
    time = np.arange(result.frames) / fps
    assert result.fps == fps
    assert clip.duration - 1 / fps < result.duration <= clip.duration + 1e-9
    heading = rotations.yaw(result.root_quat)
    np.testing.assert_allclose(heading, 0.5 * time, atol=1e-9)
    np.testing.assert_allclose(result.joint_pos[:, 0], np.sin(time), atol=1e-4)
    np.testing.assert_array_equal(result.contacts[:, 0], np.round(time * 50) > 50)
    np.testing.assert_allclose((result.root_quat**2).sum(1), 1, atol=1e-12)


def test_resampling_to_the_same_rate_is_the_identity(make_clip):
    clip = make_clip()
    result = clip.resample(clip.fps)
    for name in SERIES:
        np.testing.assert_allclose(getattr(result, name), getattr(clip, name), atol=1e-12)
    for fps in (0.0, -1.0, float("nan"), float("inf")):
        with pytest.raises(DatasetError, match="cannot resample"):
            clip.resample(fps)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda c: {"root_pos": c.root_pos[:-1]}, "expected"),
        (lambda c: {"joint_pos": c.joint_pos[:, :2]}, "joint_pos has shape"),
        (lambda c: {"root_quat": c.root_quat * 1.1}, "unit length in frame"),
        (lambda c: {"joint_vel": np.where(np.arange(60)[:, None] == 7, np.nan, c.joint_vel)},
         "joint_vel is not finite in frame 7"),
        (lambda c: {"fps": 0.0}, "frames per second"),
        (lambda c: {"weight": -1.0}, "weight"),
        (lambda c: {"joint_names": ("a", "b", "a")}, "twice"),
        (lambda c: {"contacts": np.zeros((60, 4))}, "contacts"),
        (lambda c: {name: getattr(c, name)[:0] for name in SERIES}, "no frames"),
    ],
)  # fmt: skip
def test_validate_names_what_is_wrong(make_clip, change, words):
    clip = make_clip()
    with pytest.raises(DatasetError, match=words) as caught:
        replace(clip, **change(clip)).validate()
    assert str(caught.value).startswith("clip 'circle': ")


def test_from_poses_refuses_single_frames_and_nan(make_clip):
    with pytest.raises(DatasetError, match="one frame"):
        make_clip(frames=1)
    with pytest.raises(DatasetError, match="root_pos is not finite"):
        make_clip(speed=float("nan"))


def test_clips_survive_the_disk_in_single_precision(make_clip, tmp_path):
    clips = [
        make_clip("a", frames=30, skill="walk", weight=2.0, source="dog.bvh", licence="CC0-1.0"),
        make_clip("b", frames=2, fps=60, contacts=np.array([[True, False], [False, True]])),
    ]
    path = save_clips(
        tmp_path / "clips.h5", clips, robot=("solo12", "abc"), config={"x": 1}, metadata={"k": 3}
    )
    loaded = load_clips(path, robot="solo12")
    for clip, other in zip(clips, loaded, strict=True):
        for name in ("name", "fps", "joint_names", "skill", "weight", "source", "licence"):
            assert getattr(other, name) == getattr(clip, name)
        for name in SERIES:
            np.testing.assert_array_equal(
                getattr(other, name), getattr(clip, name).astype(np.float32)
            )
    assert loaded[0].contacts is None
    np.testing.assert_array_equal(loaded[1].contacts, clips[1].contacts)
    assert read_artifact(path).metadata["k"] == 3
    with pytest.raises(ArtifactError, match="not to 'h1'"):
        load_clips(path, robot="h1")


def test_nothing_and_mixed_robots_are_refused(make_clip, tmp_path):
    with pytest.raises(DatasetError, match="no clips"):
        save_clips(tmp_path / "a.h5", [], robot=None, config={})
    with pytest.raises(DatasetError, match="clip 'b' has other joints than 'a'"):
        save_clips(
            tmp_path / "a.h5", [make_clip("a"), make_clip("b", joints=4)], robot=None, config={}
        )


@pytest.mark.parametrize("missing", ["offsets", "joint_vel"])
def test_tables_that_do_not_fit_together(make_clip, tmp_path, missing):
    good = read_artifact(save_clips(tmp_path / "a.h5", [make_clip()], robot=None, config={}))
    arrays = {name: array for name, array in good.arrays.items() if name != missing}
    path = write_artifact(
        tmp_path / "b.h5", "lacoloco/motions", arrays,
        metadata=good.metadata, config={}, seed=None, robot=None,
    )  # fmt: skip
    with pytest.raises(ArtifactError, match="do not fit together") as caught:
        load_clips(path)
    assert missing in str(caught.value)


def test_what_the_motors_were_asked_for_is_kept_at_its_own_rate(make_clip, tmp_path):
    clip = make_clip()
    asked = np.random.default_rng(0).normal(size=clip.joint_pos.shape).astype(np.float32)
    performed = replace(clip, joint_target=asked)
    path = save_clips(tmp_path / "clips.h5", [performed, clip], robot=None, config={})
    read, other = load_clips(path)
    assert np.array_equal(read.joint_target, asked) and other.joint_target is None
    assert np.array_equal(read.slice(3, 7).joint_target, asked[3:7])
    assert np.allclose(read.resample(clip.fps).joint_target, asked, atol=1e-6)
    assert read.resample(2.0 * clip.fps).joint_target is None
    with pytest.raises(DatasetError, match="joint_target has shape"):
        replace(clip, joint_target=asked[1:]).validate()


def test_at_half_the_pace_the_same_path_takes_twice_as_long(make_clip):
    clip = make_clip()
    slow = clip.at_pace(0.5)
    assert slow.duration == pytest.approx(2.0 * clip.duration)
    assert np.array_equal(slow.root_pos, clip.root_pos) and np.array_equal(
        slow.joint_pos, clip.joint_pos
    )
    for name in ("root_lin_vel_b", "root_ang_vel_b", "joint_vel"):
        assert np.allclose(getattr(slow, name), 0.5 * getattr(clip, name))
    assert slow.joint_target is None
    with pytest.raises(DatasetError, match="pace"):
        clip.at_pace(0.0)
