import base64
import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import umsgpack

from lacoloco.datasets import rotations
from lacoloco.datasets.artifact import read_artifact, write_artifact
from lacoloco.datasets.clip import save_clips
from lacoloco.datasets.store import RunStore
from lacoloco.pipelines import play as playback
from lacoloco.pipelines.errors import StageError
from lacoloco.pipelines.play import PlaybackConfig, chosen_clips
from lacoloco.pipelines.retargeting.forward_kinematics import BodyPositions
from lacoloco.pipelines.stage import StageContext
from lacoloco.pipelines.viewing import page as pages
from lacoloco.pipelines.viewing import recording
from lacoloco.pipelines.viewing.extent import standing_extent
from lacoloco.pipelines.viewing.recording import Recording, from_clip
from lacoloco.pipelines.viewing.scene import world_commands
from lacoloco.robots.registry import load_robot, robot_names

FRAMES, FPS = 20, 50.0


def make_recording(spec, name="test", **extras):
    rng = np.random.default_rng(0)
    quat = rotations.normalize(rng.normal(size=(FRAMES, 4)))
    joints = rng.uniform(-1, 1, size=(FRAMES, spec.num_joints))
    return Recording(name, FPS, rng.normal(size=(FRAMES, 3)), quat, joints, **extras)


@pytest.fixture
def full(solo12):
    """A recording with everything a recording may have."""
    rng = np.random.default_rng(1)
    return make_recording(
        solo12,
        target=rng.normal(size=(FRAMES, 3)),
        latent=rotations.normalize(rng.normal(size=(FRAMES, 7))),
        contacts=rng.random((FRAMES, 4)) > 0.5,
        skeleton=rng.normal(size=(FRAMES, 5, 3)),
        bones=((0, 1), (1, 2)),
        note="a note",
    )


@pytest.fixture
def motions(tmp_path, solo12, make_clip):
    """An artifact with two walking clips and one that reaches."""
    clips = [
        replace(
            make_clip(name=name, joints=12, skill=skill),
            joint_names=solo12.joint_names,
        )
        for name, skill in (("walk 1", "walk"), ("walk 2", "walk"), ("reach 1", "reach"))
    ]
    robot = (solo12.name, solo12.model_hash())
    return save_clips(tmp_path / "motions.h5", clips, robot=robot, config={})


@pytest.fixture
def context(tmp_path):
    return StageContext(RunStore(tmp_path / "runs"), "seen")


def data_of(page):
    """What the player of a page is given."""
    (found,) = re.findall(r"window\.PLAYBACK = (\{.*\});</script>", page)
    return json.loads(found.replace("<\\/", "</"))


def unpacked(text):
    return umsgpack.unpackb(base64.b64decode(text))


def floats(extension):
    return np.frombuffer(extension.data, dtype="<f4")


def animated(command, path):
    (tracks,) = [
        entry["clip"]["tracks"] for entry in command["animations"] if entry["path"] == path
    ]
    return {track["name"]: floats(track["values"]) for track in tracks}


def test_a_motion_set_is_shown_skill_by_skill(context, motions):
    result = playback.run(PlaybackConfig(clips=2), context, source=motions)
    assert result.metrics["recordings"] == ["walk 1", "reach 1"]
    page = (result.artifact.parent / "playback.html").read_text()
    assert result.metrics["html"].endswith("playback.html")
    assert [entry["name"] for entry in data_of(page)["recordings"]] == ["walk 1", "reach 1"]


def test_the_page_needs_nothing_from_anywhere(full, solo12):
    page = pages.build_page(solo12, [full], "a <title>")
    assert "<title>a &lt;title&gt;</title>" in page
    ours = page.replace(pages.VIEWER.read_text(), "")
    assert not re.findall(r"(?:src|href)=|https?://|@import|fetch\(", ours)


def test_the_title_names_what_is_shown_and_stays_when_it_is_played_again(context, motions):
    first = playback.run(PlaybackConfig(clips=2), context, source=motions)
    title = f"<title>{motions.stem} (solo12), 2 clips</title>"
    again = playback.run(PlaybackConfig(), context, source=first.artifact)
    for made in (first, again):
        assert title in Path(made.metrics["html"]).read_text()


def test_a_note_names_what_it_says(make_clip):
    clip = make_clip(joints=12, skill="unknown")
    assert from_clip(replace(clip, licence="CC0", source="")).note == "skill: unknown, licence: CC0"
    assert from_clip(replace(clip, skill="", licence="", source="")).note == ""


def test_the_page_fits_a_phone_and_takes_keys(full, solo12):
    page = pages.build_page(solo12, [full, full], "title")
    assert '<meta name="viewport" content="width=device-width, initial-scale=1">' in page
    ids = re.findall(r'byId\("(\w+)"\)', page)
    assert set(ids) <= set(re.findall(r'id="(\w+)"', page))  # no control that is not there
    for key in ('" "', "ArrowLeft", "ArrowRight", "ArrowUp", "ArrowDown"):
        assert f"{key}:" in page


@pytest.mark.parametrize("name", robot_names())
def test_the_whole_robot_is_in_the_picture(name):
    """The page's camera has 75 degrees from top to bottom, and looks at the height of the eye."""
    spec = load_robot(name)
    data = data_of(pages.build_page(spec, [make_recording(spec)], "title"))
    (x, z, y) = next(
        c["value"]
        for c in map(unpacked, data["scene"])
        if c["path"].startswith("/Cameras/") and c["type"] == "set_property"
    )
    level, tilt = np.hypot(x, y), np.arctan2(z, np.hypot(x, y))
    angles = []
    for height in (0.0, standing_extent(spec).top):
        angle = np.arctan2(height - data["eyeHeight"] - z, level) + tilt
        angles.append(np.degrees(angle))
    assert max(map(abs, angles)) < 30
    assert angles[1] - angles[0] > 12  # and large enough to be seen, also one that stands low


def test_a_humanoid_is_higher_than_its_pelvis(solo12):
    h1 = load_robot("h1")
    extent = standing_extent(h1)
    assert extent.top == pytest.approx(1.72, abs=0.03)  # 1.8 m says its maker, legs straight
    assert extent.size == extent.top
    lying = standing_extent(solo12)
    assert 1.0 < lying.top / solo12.default_height() < 1.2
    assert lying.size == pytest.approx(0.5, abs=0.05)  # its length


def test_a_note_cannot_end_the_script(full, solo12):
    page = pages.build_page(solo12, [replace(full, note="</script><b>")], "title")
    assert page.count("</script>") == 4
    assert data_of(page)["recordings"][0]["note"] == "</script><b>"


def test_the_page_says_what_holds_at_each_frame(full, solo12):
    (entry,) = data_of(pages.build_page(solo12, [full], "title"))["recordings"]
    assert entry["frames"] == FRAMES
    assert entry["fps"] == FPS
    np.testing.assert_allclose(entry["latent"], full.latent, atol=6e-4)
    np.testing.assert_allclose(entry["target"], full.target, atol=6e-4)
    np.testing.assert_array_equal(entry["contacts"], full.contacts)
    foot = BodyPositions(solo12.pinocchio_model(), ["FR_FOOT"])
    reached = foot(full.root_pos, full.root_quat, full.joint_pos)[:, 0]
    distance = np.linalg.norm(reached - full.target, axis=1)
    np.testing.assert_allclose(entry["distance"], distance, atol=6e-4)
    skeleton = np.frombuffer(base64.b64decode(entry["skeleton"]), "<f4")
    np.testing.assert_allclose(skeleton.reshape(full.skeleton.shape), full.skeleton, atol=1e-6)
    aside = np.linalg.norm(entry["aside"], axis=1)
    np.testing.assert_allclose(aside, pages.ASIDE * solo12.default_height(), atol=2e-3)


@pytest.mark.parametrize("name", robot_names())
def test_the_scene_moves_every_body_to_where_mujoco_has_it(name):
    import mujoco

    spec = load_robot(name)
    shown = make_recording(spec)
    data = data_of(pages.build_page(spec, [shown], "title"))
    command = unpacked(data["recordings"][0]["animation"])
    fixed = {c["path"]: c for c in map(unpacked, data["scene"]) if c["type"] == "set_transform"}

    model = spec.model()
    state = mujoco.MjData(model)
    frame = 7
    state.qpos[:] = np.r_[shown.root_pos[frame], shown.root_quat[frame], shown.joint_pos[frame]]
    mujoco.mj_kinematics(model, state)
    paths = {}
    for body in range(1, model.nbody):
        parent = model.body_parentid[body]
        paths[body] = "/world/robot" if parent == 0 else f"{paths[parent]}/{model.body(body).name}"
        pose = np.eye(4)
        path = ""
        for part in paths[body].removeprefix("/world").split("/")[1:]:
            path += f"/{part}"
            pose = pose @ local_pose(command, fixed, f"/world{path}", frame)
        np.testing.assert_allclose(pose[:3, 3], state.xpos[body], atol=1e-5)
        np.testing.assert_allclose(pose[:3, :3].ravel(), state.xmat[body], atol=1e-5)


def local_pose(command, fixed, path, frame):
    """Pose of a node relative to its parent, as the viewer would have it."""
    pose = np.eye(4)
    if path in fixed:
        pose = np.array(fixed[path]["matrix"]).reshape(4, 4).T
    if any(entry["path"] == path for entry in command["animations"]):
        series = animated(command, path)
        x, y, z, w = series[".quaternion"].reshape(-1, 4)[frame]
        pose[:3, :3] = rotations.to_matrix(np.array([w, x, y, z], dtype=float))
        if ".position" in series:
            pose[:3, 3] = series[".position"].reshape(-1, 3)[frame]
    return pose


@pytest.mark.parametrize(
    ("node", "metres"),
    [("/Cameras/default/", [0.65, 0.3, 0.75]), ("/Lights/SpotLight/", [0.51, 0.79, 2.98])],
)
def test_camera_and_light_stand_back_from_a_larger_robot(solo12, node, metres):
    small, large = (
        next(
            c["value"]
            for c in world_commands(size)
            if c["path"].startswith(node) and c["property"] == "position"
        )
        for size in (standing_extent(solo12).size, 1.0)
    )
    assert small == pytest.approx(metres, abs=2e-2)
    assert np.allclose(large, np.array(small) / standing_extent(solo12).size)


def test_every_geom_of_the_robot_is_drawn(solo12, full):
    data = data_of(pages.build_page(solo12, [full], "title"))
    objects = [c["path"] for c in map(unpacked, data["scene"]) if c["type"] == "set_object"]
    for geom in range(solo12.model().ngeom):
        assert any(f"/geom{geom}/" in path for path in objects)
    for foot in data["feet"]:
        assert all(any(path.startswith(f"/{geom}/") for path in objects) for geom in foot["geoms"])


def test_recordings_survive_their_artifact(context, full, motions, solo12, tmp_path):
    arrays, metadata = recording.to_arrays([full, make_recording(solo12, "bare")])
    path = write_artifact(
        tmp_path / "again.h5",
        playback.SCHEMA,
        arrays,
        metadata=metadata,
        config={},
        seed=0,
        robot=(solo12.name, solo12.model_hash()),
    )
    again, bare = playback.record(read_artifact(path), PlaybackConfig())
    for name in (*recording.POSES, *recording.EXTRAS):
        np.testing.assert_array_equal(getattr(again, name), getattr(full, name))
    assert (again.name, again.fps, again.bones, again.note) == ("test", FPS, full.bones, "a note")
    assert bare.target is None
    assert playback.title_of(read_artifact(path), "solo12", [again, bare]).endswith("2 episodes")
    assert playback.run(PlaybackConfig(), context, source=path).metrics["recordings"] == [
        "test",
        "bare",
    ]


def test_clips_are_found_by_name(motions):
    artifact = read_artifact(motions)
    (shown,) = playback.record(artifact, PlaybackConfig(), names=["walk 2"])
    assert shown.name == "walk 2"
    with pytest.raises(StageError, match=r"'walk 3'.*'walk 2'|'walk 3'.*'walk 1'"):
        playback.record(artifact, PlaybackConfig(), names=["walk 3"])


def test_clips_of_all_skills_get_their_turn(make_clip):
    clips = [make_clip(name=str(i), skill="walk" if i < 5 else "reach") for i in range(7)]
    assert chosen_clips(clips, 4, ()) == [0, 5, 1, 6]
    assert len(chosen_clips(clips, 20, ())) == 7


def test_an_artifact_of_numbers_shows_nothing(tmp_path, context):
    path = write_artifact(
        tmp_path / "rows.h5",
        "lacoloco/evaluation",
        {"rows": np.zeros(3)},
        metadata={},
        config={},
        seed=0,
        robot=("solo12", "0"),
    )
    with pytest.raises(StageError, match="shows nothing"):
        playback.run(PlaybackConfig(), context, source=path)
    assert not context.store.partials("seen", "play")


@pytest.mark.parametrize("series", ["joint_pos", "target", "contacts", "root_quat"])
def test_series_of_the_wrong_length_are_refused(full, solo12, series):
    broken = replace(full, **{series: getattr(full, series)[:-1]})
    if series == "root_quat":
        broken = replace(full, root_quat=np.full((FRAMES, 4), np.nan))
    with pytest.raises(StageError, match=series):
        broken.validate(solo12.num_joints)
    full.validate(solo12.num_joints)


def test_a_recording_is_cut_with_everything_in_it(full, solo12):
    part = full.until(0.1)
    assert part.frames == 6
    part.validate(solo12.num_joints)
    assert part.latent.shape == (6, 7)
