from dataclasses import replace

import numpy as np
import pytest

from lacoloco.datasets import rotations
from lacoloco.datasets.clip import Clip
from lacoloco.datasets.errors import DatasetError
from lacoloco.datasets.foreign.motion import ForeignMotion
from lacoloco.datasets.foreign.tables import LAFAN_FPS
from lacoloco.pipelines.errors import StageError
from lacoloco.pipelines.foreign_motions.base import root_quaternions
from lacoloco.pipelines.foreign_motions.config import ImportConfig
from lacoloco.pipelines.foreign_motions.convert import convert
from lacoloco.pipelines.foreign_motions.ground import foot_contacts, ground_height
from lacoloco.pipelines.foreign_motions.joints import breadth_first, joint_columns, legs
from lacoloco.pipelines.foreign_motions.writing import FORMATS, encoded, npz_arrays
from lacoloco.pipelines.sim.body_states import body_states
from lacoloco.robots.registry import load_robot

FPS = 50.0


@pytest.fixture(scope="module")
def spec():
    return load_robot("solo12")


@pytest.fixture
def walk(spec):
    """The robot glides and turns while every joint swings around its default by another phase."""
    time = np.arange(80) / FPS
    forward = np.column_stack([0.4 * time, 0.1 * time, 0 * time + spec.default_height()])
    swing = 0.1 * np.sin(6 * time[:, None] + np.arange(spec.num_joints))
    quat = rotations.exp_map(np.column_stack([0.05 * np.sin(time), 0 * time, 0.8 * time]))
    joints = np.asarray(spec.default_joint_pos) + swing
    return Clip.from_poses("walk", FPS, spec.joint_names, forward, quat, joints)


def foreign(**changes):
    frames = 20
    values = {
        "name": "file",
        "kind": "CSV",
        "root_pos": np.zeros((frames, 3)),
        "root_quat": rotations.from_yaw(np.linspace(0.0, 0.5, frames)),
        "quat_order": None,
        "joint_pos": np.zeros((frames, 12)),
        "joint_names": None,
        "joint_order": None,
        "fps": 50.0,
    }
    return ForeignMotion(**{**values, **changes})


@pytest.mark.parametrize("form", FORMATS)
def test_what_is_exported_comes_back(spec, walk, tmp_path, form):
    fps = LAFAN_FPS if form == "lafan1" else FPS
    walk = walk.at_pace(fps / FPS)
    file = tmp_path / f"walk{FORMATS[form]}"
    file.write_bytes(encoded(spec, walk, form))
    config = ImportConfig(keep_height=True, fps=fps)
    if form == "lafan1":  # which says neither its rate nor its joints
        with pytest.raises(DatasetError, match="--source-fps"):
            convert(spec, file, config, "walk")
        config = replace(config, source_fps=fps, joints="model")
    back = convert(spec, file, config, "walk").clip
    assert (back.name, back.fps, back.joint_names) == ("walk", fps, spec.joint_names)
    for name in ("root_pos", "joint_pos", "root_lin_vel_b", "root_ang_vel_b", "joint_vel"):
        np.testing.assert_allclose(getattr(back, name), getattr(walk, name), atol=2e-5)
    turned = rotations.angular_velocity_b(back.root_quat, walk.root_quat, 1.0)
    assert np.abs(turned).max() < 1e-6


def test_lafan1_has_its_own_rate_whatever_the_clip_has(spec, walk):
    """Its readers take it for 30 frames per second: 80 at 50 are 1.58 s, so 48."""
    assert len(encoded(spec, walk, "lafan1").splitlines()) == 48


def test_velocities_of_the_bodies_are_those_of_their_places(spec, walk):
    arrays = npz_arrays(spec, walk)
    assert arrays["body_names"][0] == spec.model().body(1).name
    assert list(arrays["joint_names"]) == list(spec.joint_names)
    moved = np.gradient(arrays["body_pos_w"].astype(float), 1 / FPS, axis=0)
    inner = slice(2, -2)
    np.testing.assert_allclose(arrays["body_lin_vel_w"][inner], moved[inner], atol=0.01)
    quat = arrays["body_quat_w"].astype(float)
    turned = rotations.rotate(
        quat[1:-1], rotations.angular_velocity_b(quat[:-2], quat[2:], 2 / FPS)
    )
    # of a body that turns about two axes, in the middle of the two frames
    np.testing.assert_allclose(arrays["body_ang_vel_w"][1:-1][inner], turned[inner], atol=0.02)


def test_the_rate_becomes_that_of_the_policies(spec, walk, tmp_path):
    file = tmp_path / "walk.csv"
    file.write_bytes(encoded(spec, walk, "csv"))
    slow = convert(spec, file, ImportConfig(source_fps=30.0), "walk")
    assert slow.metrics["source_fps"] == 30.0
    assert slow.clip.fps == 50.0 and slow.clip.duration == pytest.approx(79 / 30, abs=1 / 50)
    with pytest.raises(DatasetError, match="lasts days"):
        convert(spec, file, ImportConfig(source_fps=1e-4), "walk")
    speed = np.linalg.norm(slow.clip.root_lin_vel_b[:, :2], axis=1)
    np.testing.assert_allclose(speed, 30 / 50 * np.hypot(0.4, 0.1), atol=1e-3)


def test_joints_are_found_by_name_whatever_their_order(spec, walk, tmp_path):
    file = tmp_path / "walk.csv"
    lines = encoded(spec, walk, "csv").decode().splitlines()
    order = np.random.default_rng(0).permutation(len(lines[0].split(",")))
    cells = [np.array(line.split(","))[order] for line in lines]
    cells[0] = np.array([f"{c}_joint" if c in spec.joint_names else c for c in cells[0]])
    file.write_text("\n".join(",".join([*row, "9"]) for row in cells).replace("9", "wrist", 1))
    file.write_text("\n".join(",".join([*row, "wrist" if i == 0 else "9"]) for i, row in
                              enumerate(cells)))  # fmt: skip
    back = convert(spec, file, ImportConfig(), "walk")
    np.testing.assert_allclose(back.clip.joint_pos, walk.joint_pos, atol=1e-6)
    assert back.metrics["left_out"] == ["wrist"] and "left out" in back.remarks[-1]


def test_orders_that_follow_from_the_robot(spec):
    assert breadth_first(spec)[:5] == ["FL_HAA", "FR_HAA", "HL_HAA", "HR_HAA", "FL_HFE"]
    expected = [
        f"{leg}_{part}" for leg in ("FR", "FL", "HR", "HL") for part in ("HAA", "HFE", "KFE")
    ]
    assert legs(spec) == expected
    with pytest.raises(StageError, match="on four legs"):
        legs(load_robot("h1"))
    columns, left_out = joint_columns(spec, foreign(), "legs")
    assert [expected[column] for column in columns] == list(spec.joint_names) and not left_out
    names = ",".join(expected)
    assert joint_columns(spec, foreign(), names)[0] == columns


@pytest.mark.parametrize(
    ("motion", "asked", "words"),
    [
        ({}, None, "does not say which column is which joint: say --joints"),
        ({}, "a,b", "has 12 joints, but 2 are named"),
        ({"joint_names": tuple("abcdefghijkl")}, None, "has no joint FL_HAA"),
        ({"joint_pos": np.zeros((20, 29))}, "model", "has 29 joints, but 12 are named"),
    ],
)  # fmt: skip
def test_joints_that_are_not_known_are_asked_for(spec, motion, asked, words):
    with pytest.raises(StageError, match=words) as caught:
        joint_columns(spec, foreign(**motion), asked)
    assert "\n" not in str(caught.value)


def test_another_order_is_noticed_by_the_ranges_of_the_joints(spec, walk, tmp_path):
    file = tmp_path / "walk.csv"
    wrong = replace(walk, joint_pos=walk.joint_pos + 4.0)
    file.write_bytes(encoded(spec, wrong, "csv"))
    with pytest.raises(StageError, match="beyond its range in 100 % of the frames"):
        convert(spec, file, ImportConfig(), "walk")


YAW = rotations.from_yaw(np.linspace(0.0, 1.5, 20))
TILTED = rotations.exp_map(np.tile([2.0, 0.0, 0.0], (20, 1)))


def test_the_order_of_the_quaternion_is_that_in_which_the_base_is_upright():
    for quat, order in ((YAW, "wxyz"), (YAW[:, [1, 2, 3, 0]], "xyzw")):
        found, named = root_quaternions(foreign(root_quat=quat), None)
        assert named == order
        np.testing.assert_allclose(found, YAW, atol=1e-12)
    flips = np.where(np.arange(20) % 3 == 0, -1.0, 1.0)[:, None]
    found, _ = root_quaternions(foreign(root_quat=1.003 * flips * YAW), None)
    assert ((found[1:] * found[:-1]).sum(1) > 0.9).all()
    np.testing.assert_allclose(np.linalg.norm(found, axis=1), 1.0)


@pytest.mark.parametrize(
    ("quat", "order", "words"),
    [
        (rotations.from_yaw(np.full(20, np.pi)), None, "cannot be told"),  # upright in both
        (rotations.from_yaw(np.full(20, 0.1))[:, [1, 2, 3, 0]], None, "cannot be told"),
        (TILTED, None, "cannot be told"),
        (YAW, "xyzw", "upright as wxyz only"),
        (np.full((20, 4), 0.5), "xyzw", "never upright"),  # Laikago's base in motion_imitation
        (2.0 * YAW, None, "has length 2"),
    ],
)
def test_what_cannot_be_told_is_asked_for(quat, order, words):
    motion = foreign(root_quat=quat, quat_order=order)
    with pytest.raises(DatasetError, match=words):
        root_quaternions(motion, None)
    if words != "has length 2":
        assert root_quaternions(motion, "xyzw")[1] == "xyzw"


def standing(spec, height, **bent):
    frames = 30
    joints = np.tile(spec.default_joint_pos, (frames, 1))
    for joint, angle in bent.items():
        joints[10:20, spec.joint_names.index(joint)] += angle
    pos = np.tile([0.0, 0.0, spec.default_height() + height], (frames, 1))
    return body_states(spec, pos, np.tile([1.0, 0, 0, 0], (frames, 1)), joints)


def test_feet_that_stand_are_found_by_heights(spec):
    assert ground_height(spec, standing(spec, 0.1)) == pytest.approx(0.1, abs=1e-6)
    assert foot_contacts(spec, standing(spec, 0.0), FPS).all()
    assert not foot_contacts(spec, standing(spec, 0.1), FPS).any()
    down = foot_contacts(spec, standing(spec, 0.0, FL_KFE=-0.8), FPS)
    lifted = spec.feet.index(next(foot for foot in spec.feet if foot.startswith("FL")))
    assert not down[11:19, lifted].any() and down[:9, lifted].all() and down[21:, lifted].all()
    assert np.delete(down, lifted, axis=1).all()


def test_feet_that_slide_do_not_stand(spec):
    states = standing(spec, 0.0)
    states.pos[..., 0] += 1.0 * np.arange(30)[:, None] / FPS
    assert not foot_contacts(spec, states, FPS).any()


def test_a_motion_is_put_on_the_ground(spec, tmp_path):
    joints = np.tile(spec.default_joint_pos, (40, 1))
    pos = np.tile([0.0, 0.0, spec.default_height() + 0.2], (40, 1))
    quat = np.tile([1.0, 0, 0, 0], (40, 1))
    clip = Clip.from_poses("high", FPS, spec.joint_names, pos, quat, joints)
    file = tmp_path / "high.npz"
    file.write_bytes(encoded(spec, clip, "npz"))
    made = convert(spec, file, ImportConfig(), "high")
    np.testing.assert_allclose(made.clip.root_pos[:, 2], spec.default_height(), atol=1e-6)
    assert made.metrics["lifted_m"] == pytest.approx(-0.2, abs=1e-6)
    assert made.clip.contacts.all() and "stand at height 0.200 m" in made.remarks[0]
    kept = convert(spec, file, ImportConfig(keep_height=True), "high")
    assert kept.clip.root_pos[0, 2] == pytest.approx(spec.default_height() + 0.2, abs=1e-6)
    assert not kept.clip.contacts.any()
