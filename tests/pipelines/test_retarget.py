from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from lacoloco.datasets.artifact import read_artifact
from lacoloco.datasets.clip import load_clips
from lacoloco.datasets.errors import ConfigError, DatasetError
from lacoloco.datasets.mocap import load_bvh
from lacoloco.datasets.samples import DOG_BVH
from lacoloco.datasets.store import RunStore
from lacoloco.pipelines import retarget
from lacoloco.pipelines.errors import StageError
from lacoloco.pipelines.retarget import RetargetConfig
from lacoloco.pipelines.retargeting.retargeter import ground_lift, parse_scale
from lacoloco.pipelines.stage import StageContext
from lacoloco.robots.registry import load_robot

METRICS = {
    "frames",
    "keypoint_error_mean_m",
    "keypoint_error_max_m",
    "foot_skate_mean_m_s",
    "ground_penetration_max_m",
    "joint_limit_hits",
    "solver_failures",
    "stance_float_max_m",
    "joint_jerk_peak",
    "height_error_mean_m",
    "torque_share_p95",
}
QUICK = RetargetConfig(pictures=False)

retarget_run = partial(retarget.run, robot="solo12")


@pytest.fixture
def context(tmp_path):
    return StageContext(RunStore(tmp_path / "runs"), "dog", command="lacoloco retarget")


@pytest.fixture(scope="module")
def whole_dog(tmp_path_factory):
    """The bundled dog, retargeted as by default."""
    store = RunStore(tmp_path_factory.mktemp("dog") / "runs")
    return retarget_run(RetargetConfig(), StageContext(store, "dog"))


@pytest.mark.parametrize(
    ("config", "worst_error"),
    [
        (RetargetConfig(), 0.01),
        (RetargetConfig(mode="paper", scale="auto"), 0.02),
        (RetargetConfig(mode="paper"), 0.06),
    ],
)
def test_the_bundled_dog_becomes_a_clip(context, whole_dog, config, worst_error):
    result = whole_dog if config == RetargetConfig() else retarget_run(config, context)
    (row,) = result.metrics["clips"]
    assert set(row) >= METRICS
    assert row["frames"] == 721
    assert row["solver_failures"] == 0
    assert row["keypoint_error_mean_m"] < worst_error
    assert row["ground_penetration_max_m"] < 1e-6
    assert result.metrics["frames_per_second"] > 0

    (clip,) = load_clips(result.artifact, robot="solo12")
    assert clip.joint_names == load_robot("solo12").joint_names
    assert (clip.skill, clip.licence, clip.source) == ("dog", "CC0-1.0", DOG_BVH.name)
    assert clip.contacts.shape == (721, 4)
    artifact = read_artifact(result.artifact)
    assert [Path(parent.path).name for parent in artifact.parents] == [DOG_BVH.name]
    assert artifact.config["mode"] == config.mode
    assert artifact.metadata["metrics"]["clips"] == [row]


def test_the_robot_goes_where_the_dog_goes_at_its_own_size(whole_dog):
    result = whole_dog
    (clip,) = load_clips(result.artifact)
    scale = result.metrics["clips"][0]["scale"]
    hips = load_bvh(DOG_BVH).keypoints(["Hips"])[:, 0]
    travelled = np.linalg.norm(np.diff(hips[::60, :2], axis=0), axis=1).sum()
    walked = np.linalg.norm(np.diff(clip.root_pos[::60, :2], axis=0), axis=1).sum()
    assert walked == pytest.approx(scale * travelled, rel=0.03)
    # forward in its own frame, level, at a height its legs can bend at
    assert clip.root_lin_vel_b[:, 0].mean() > 0.3
    assert abs(clip.root_lin_vel_b[:, 1].mean()) < 0.05
    assert 0.22 < clip.root_pos[:, 2].mean() < 0.31


def test_knees_bend_as_in_the_neutral_pose(whole_dog):
    (clip,) = load_clips(whole_dog.artifact)
    knees = clip.joint_pos[:, 2::3]
    assert (knees < -0.1).mean() > 0.99


def test_velocities_belong_to_the_poses(whole_dog):
    (clip,) = load_clips(whole_dog.artifact)
    step = np.diff(clip.joint_pos, axis=0) * clip.fps
    between = (clip.joint_vel[1:] + clip.joint_vel[:-1]) / 2
    assert np.corrcoef(step.ravel(), between.ravel())[0, 1] > 0.99


def test_an_animal_that_turns_right_makes_a_robot_that_turns_right(whole_dog):
    (clip,) = load_clips(whole_dog.artifact)
    points = load_bvh(DOG_BVH).keypoints(["Hips", "Neck"])
    forward = points[:, 1] - points[:, 0]
    course = np.unwrap(np.arctan2(forward[:, 1], forward[:, 0]))
    assert abs(course[-1] - course[0]) > 0.5
    turned = clip.root_ang_vel_b[:, 2].sum() / clip.fps
    assert turned == pytest.approx(course[-1] - course[0], abs=0.3)


def test_a_leap_stays_a_leap_and_the_base_does_not_jump():
    fps, time = 60.0, np.arange(240) / 60
    flight = np.where((time > 1.8) & (time < 2.2), 0.15 * np.sin((time - 1.8) / 0.4 * np.pi), 0.0)
    heights = 0.1 + flight[:, None] + np.zeros((1, 4))
    lift = ground_lift(heights, 0.02, fps)[:, 2]
    grounded = heights + lift[:, None]
    assert grounded.min() == pytest.approx(0.02, abs=1e-9)
    assert grounded[126].min() == pytest.approx(0.02 + flight[126], abs=1e-3)
    assert np.abs(np.diff(lift)).max() < 1e-3


def test_no_foot_is_ever_below_the_ground():
    heights = np.random.default_rng(0).normal(size=(200, 4)).cumsum(0)
    assert (heights + ground_lift(heights, 0.02, 60.0)[:, 2:]).min() >= 0.02 - 1e-9


def test_one_bad_file_is_reported_and_the_rest_is_kept(context, short_dog, tmp_path):
    bad = tmp_path / "bad.bvh"
    bad.write_text("HIERARCHY\nnonsense")
    files = [bad, short_dog(), short_dog(slice(100, 160), "b.bvh")]
    result = retarget_run(QUICK, context, sources=files, jobs=1)
    assert [clip.name for clip in load_clips(result.artifact)] == ["short", "b"]
    (skipped,) = result.metrics["skipped"]
    assert skipped["file"] == str(bad)
    assert str(bad) in skipped["error"]


def test_the_only_file_being_bad_is_an_error_and_leaves_nothing(context, tmp_path):
    bad = tmp_path / "bad.bvh"
    bad.write_bytes(b"\x89PNG\r\n")
    context.store.use("before")
    with pytest.raises(DatasetError, match=r"bad\.bvh"):
        retarget_run(RetargetConfig(), context, sources=[bad])
    assert not context.store.all("dog", "retarget")
    assert not context.store.partials("dog", "retarget")
    with pytest.raises(DatasetError, match=r"none\.bvh"):
        retarget_run(RetargetConfig(), replace(context, run="other"), sources=["none.bvh"])
    assert (context.store.last_run(), context.store.runs()) == ("before", ["dog"])


def test_all_of_several_files_being_bad_is_an_error(context, tmp_path):
    with pytest.raises(StageError, match=r"none of 2 files.*a\.bvh"):
        retarget_run(RetargetConfig(), context, sources=[tmp_path / "a.bvh", tmp_path / "b.bvh"])


def test_a_single_frame_is_no_motion(context, short_dog):
    with pytest.raises(DatasetError, match="one frame"):
        retarget_run(RetargetConfig(), context, sources=[short_dog(slice(0, 1))])


def test_a_missing_joint_is_named(context, short_dog):
    path = short_dog()
    path.write_text(path.read_text().replace("LeftForeArm", "Elbow").replace("RightHand", "Paw"))
    with pytest.raises(DatasetError, match="RightHand"):
        retarget_run(RetargetConfig(), context, sources=[path])


@pytest.mark.parametrize(("text", "value"), [("none", None), ("auto", "auto"), ("0.7", 0.7)])
def test_scales_that_are_understood(text, value):
    assert parse_scale(text) == value


@pytest.mark.parametrize("text", ["0", "-1", "inf", "nan", "big"])
def test_scales_that_are_not(text):
    with pytest.raises(StageError, match="scale"):
        parse_scale(text)


def test_the_clip_of_the_original_has_no_failure(shared, context):
    path = shared / "data/mocap/bvh/D1_031_KAN01_001.bvh"
    result = retarget_run(retarget.paper(), context, sources=[path])
    (row,) = result.metrics["clips"]
    assert (row["frames"], row["solver_failures"]) == (1263, 0)
    assert row["scale"] == 1.0
    assert row["keypoint_error_mean_m"] < 0.06


def test_thirty_frames_per_second_in_another_channel_order(shared, context):
    path = shared / "data/mocap/bvh/Dog_example_zyx_30fps.bvh"
    result = retarget_run(RetargetConfig(), context, sources=[path])
    (clip,) = load_clips(result.artifact)
    assert clip.fps == pytest.approx(30.0, rel=1e-3)
    assert result.metrics["clips"][0]["solver_failures"] == 0


def arrays(result):
    return read_artifact(result.artifact).arrays


def test_each_clip_has_its_picture(context, short_dog):
    files = [short_dog(), short_dog(slice(100, 160), "b.bvh")]
    one = retarget_run(RetargetConfig(), context, sources=files[:1])
    assert (one.artifact.parent / "report.png").read_bytes().startswith(b"\x89PNG")
    two = retarget_run(RetargetConfig(), context, sources=files, jobs=1)
    pictures = sorted(path.name for path in (two.artifact.parent / "reports").iterdir())
    assert pictures == ["b.png", "short.png"]
    assert sorted(path.name for path in two.artifact.parent.iterdir()) == ["artifact.h5", "reports"]


@pytest.mark.slow
def test_several_processes_make_the_same_and_report_what_is_bad(
    context, short_dog, tmp_path, monkeypatch
):
    bad = tmp_path / "bad.bvh"
    bad.write_text("HIERARCHY")
    files = [short_dog(), bad, short_dog(slice(100, 160), "b.bvh")]
    alone = retarget_run(QUICK, context, sources=files, jobs=1)
    # The other processes look after somebody has committed.
    monkeypatch.setattr("lacoloco.pipelines.retargeting.worker.git_commit", lambda: "before")
    spread = retarget_run(QUICK, replace(context, run="spread"), sources=files, jobs=2)
    assert [clip.name for clip in load_clips(spread.artifact)] == ["short", "b"]
    assert spread.metrics["skipped"] == alone.metrics["skipped"]
    np.testing.assert_array_equal(arrays(spread)["joint_pos"], arrays(alone)["joint_pos"])


def test_a_selection_takes_parts_of_files_and_tells_what_is_absent(context, short_dog, tmp_path):
    short_dog()
    selection = tmp_path / "mine.toml"
    selection.write_text("[clips]\nshort = [10, 50]\ngone = []\n")
    config = replace(QUICK, select=str(selection))
    result = retarget_run(config, context, sources=[tmp_path])
    (row,) = result.metrics["clips"]
    assert row["frames"] == 40
    assert result.metrics["absent"] == ["gone"]
    selection.write_text("[clips]\ngone = []\n")
    with pytest.raises(StageError, match="none of its 1 recordings"):
        retarget_run(config, context, sources=[tmp_path])


def test_part_rate_and_mirror_image(context, short_dog):
    path = short_dog(slice(0, 120))
    plain = retarget_run(replace(QUICK, trim="0.5s:1.5s", fps=30.0), context, sources=[path])
    config = replace(QUICK, trim="0.5s:1.5s", fps=30.0, mirror=True)
    image = retarget_run(config, context, sources=[path])
    (straight,), (mirrored,) = load_clips(plain.artifact), load_clips(image.artifact)
    assert (straight.frames, straight.fps) == (30, 30.0)
    np.testing.assert_array_equal(mirrored.contacts[:, [1, 0, 3, 2]], straight.contacts)
    np.testing.assert_allclose(mirrored.root_pos * [1, -1, 1], straight.root_pos, atol=2e-3)
    left, right = mirrored.joint_pos[:, [0, 1, 2]], straight.joint_pos[:, [3, 4, 5]]
    np.testing.assert_allclose(left * [-1, 1, 1], right, atol=0.02)


def test_every_file_in_six_variants(context, short_dog):
    """Mirror images, and both on bent courses; each is what its own options give, and is kept when
    asked for again.
    """
    path = short_dog(slice(0, 60))
    config = replace(QUICK, augment=True, augment_bends=(0.8, -0.5))
    result = retarget_run(config, context, sources=[path])
    clips = {clip.name.removeprefix(path.stem): clip for clip in load_clips(result.artifact)}
    assert list(clips) == [
        "",
        "_mirror",
        "_bend+0.8",
        "_mirror_bend-0.8",
        "_bend-0.5",
        "_mirror_bend+0.5",
    ]
    alone = retarget_run(
        replace(QUICK, mirror=True, bend=-0.8), context, sources=[path], force=True
    )
    np.testing.assert_array_equal(
        clips["_mirror_bend-0.8"].root_pos, load_clips(alone.artifact)[0].root_pos
    )
    readings = [row["reading"] for row in result.metrics["clips"]]
    assert [(one["mirror"], one["bend"]) for one in readings[1:4]] == [
        (True, 0),
        (False, 0.8),
        (True, -0.8),
    ]


def test_another_skeleton_needs_a_map_and_then_gives_the_same(context, short_dog, tmp_path):
    path = short_dog()
    plain = retarget_run(QUICK, context, sources=[path])
    other = tmp_path / "other.bvh"
    other.write_text(path.read_text().replace("Hand", "Wrist").replace("UpLeg", "Thigh"))
    with pytest.raises(DatasetError, match="'mann-dog', needs LeftHand, RightHand, LeftUpLeg"):
        retarget_run(QUICK, context, sources=[other])
    text = (Path(retarget.__file__).parent / "retargeting/mocap/maps/mann-dog.toml").read_text()
    own = tmp_path / "own.toml"
    own.write_text(text.replace("Hand", "Wrist").replace("UpLeg", "Thigh"))
    result = retarget_run(replace(QUICK, map=str(own)), context, sources=[other])
    np.testing.assert_array_equal(arrays(result)["joint_pos"], arrays(plain)["joint_pos"])
    own.write_text(own.read_text().replace('scale = "limbs"', "scale = 0.6"))
    result = retarget_run(replace(QUICK, map=str(own)), context, sources=[other])
    assert result.metrics["clips"][0]["scale"] == 0.6


def test_warnings_are_kept_with_the_clip(context, short_dog):
    path = short_dog()
    text = path.read_text().replace("Left", "@").replace("Right", "Left").replace("@", "Right")
    path.write_text(text)
    result = retarget_run(replace(QUICK, mode="paper"), context, sources=[path])
    clip = result.metrics["clips"][0]
    assert "sides_swapped" in clip["warnings"]
    assert any("left and right" in note for note in clip["notes"])
    mended = retarget_run(replace(QUICK, mode="paper", swap_sides=True), context, sources=[path])
    assert "sides_swapped" not in mended.metrics["clips"][0]["warnings"]


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"trim": "5"}, "--trim 5"),
        ({"fps": -1.0}, "fps=-1.0: use a number from 0"),
        ({"unit": -1.0}, "unit=-1.0: use a number from 0"),
        ({"bend": float("nan")}, "bend=nan: use a number from -100"),
        ({"augment_bends": (float("inf"),)}, "augment_bends"),
        ({"up_axis": "w"}, "up_axis=w: use one of"),
        ({"select": "paper-dogs", "trim": "0:5"}, "--trim: a selection"),
        ({"map": "gone.toml"}, "gone.toml"),
    ],
)
def test_impossible_options_are_refused_before_the_work(context, change, words):
    with pytest.raises((StageError, ConfigError), match=words):
        retarget_run(replace(QUICK, **change), context)
    assert not context.store.partials("dog", "retarget")


def test_what_is_mostly_guessed_is_no_clip(context, short_dog):
    """The sample at five times the robot's size: its legs reach no target."""
    with pytest.raises(DatasetError, match="could not be solved: the robot cannot do this"):
        retarget_run(replace(QUICK, scale="5"), context, sources=[short_dog()])
