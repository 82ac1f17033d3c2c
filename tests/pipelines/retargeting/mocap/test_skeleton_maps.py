from dataclasses import replace

import numpy as np
import pytest

from lacoloco.datasets.errors import DatasetError
from lacoloco.datasets.mocap import load_bvh
from lacoloco.datasets.samples import DOG_BVH
from lacoloco.pipelines.errors import StageError
from lacoloco.pipelines.retargeting.config import RetargetConfig
from lacoloco.pipelines.retargeting.mocap.body_map import body_map
from lacoloco.pipelines.retargeting.mocap.skeleton_maps import (
    choose_map,
    load_map,
    map_of,
    shipped_maps,
)
from lacoloco.pipelines.retargeting.retargeter import mapped
from lacoloco.pipelines.retargeting.worker import Task, Worker
from lacoloco.robots.registry import load_robot

JOINTS = load_bvh(DOG_BVH).joint_names
TABLE = {
    "robot": "solo12",
    "keypoints": {"Elbow": "FL_SHOULDER", "Wrist": "FL_FOOT"},
    "contacts": {"FL_FOOT": "Palm"},
}


def test_the_map_of_the_paper_is_that_of_the_robot():
    (dog,) = [skeleton for skeleton in shipped_maps() if skeleton.name == "mann-dog"]
    assert dict(dog.keypoints) == dict(load_robot("solo12").keypoints)
    assert (dog.up_axis, dog.unit, dog.scale) == ("y", 0.01, "limbs")


@pytest.mark.parametrize("skeleton", shipped_maps(), ids=lambda skeleton: skeleton.name)
def test_every_map_fits_its_robot(skeleton):
    spec = mapped(load_robot(skeleton.robot), skeleton)
    assert set(skeleton.contacts) == (set() if spec.soles else set(spec.feet))
    assert set(spec.foot_points) <= set(spec.keypoints.values())
    assert skeleton.about


def test_the_map_is_chosen_by_the_joints():
    assert choose_map(shipped_maps(), "solo12", JOINTS, "dog.bvh").name == "mann-dog"


RIGIFY = {"Shoulder": "front_thigh", "Hand": "front_foot", "UpLeg": "thigh", "Foot": "foot"}


def test_a_skeleton_of_blender_gives_the_same_targets(tmp_path):
    text = DOG_BVH.read_text()
    for side in ("Left", "Right"):
        for ours, theirs in RIGIFY.items():
            text = text.replace(f"{side}{ours}\n", f"{theirs}.{side[0]}\n")
    path = tmp_path / "wolf.bvh"
    path.write_text(text)
    config = RetargetConfig(mode="paper", scale="auto", up_axis="y", unit=0.01)
    wolf = Worker(config, "solo12").read(Task(path, "wolf"))
    dog = Worker(config, "solo12").read(Task(DOG_BVH, "dog"))
    assert "front_thigh.L" in wolf[0].joint_names
    ours, theirs = (retargeter._targets(mocap) for mocap, _, retargeter, _ in (dog, wolf))
    np.testing.assert_allclose(ours.points, theirs.points)
    np.testing.assert_array_equal(ours.contacts, theirs.contacts)


def test_an_unknown_skeleton_is_told_what_is_missing_and_what_is_nearest():
    joints = [f"L_{name}" if name == "LeftHand" else name for name in JOINTS]
    other = map_of(TABLE, "arm", "arm.toml")
    with pytest.raises(DatasetError, match=r"cat\.bvh: .*'mann-dog', needs LeftHand, .*--map"):
        choose_map([other, *shipped_maps()], "solo12", joints, "cat.bvh")


def test_of_two_maps_that_fit_the_one_with_more_joints_is_taken():
    small = map_of({**TABLE, "keypoints": {"LeftHand": "FL_FOOT"}}, "small", "small.toml")
    assert choose_map([small, *shipped_maps()], "solo12", JOINTS, "x").name == "mann-dog"


def test_a_robot_without_a_map_is_named():
    with pytest.raises(StageError, match="rover.*keypoints.*copy one of.*--map"):
        choose_map(shipped_maps(), "rover", JOINTS, "dog.bvh")


def test_a_map_of_ones_own(tmp_path):
    path = tmp_path / "arm.toml"
    path.write_text(
        'robot = "solo12"\nup_axis = "-z"\nunit = 1\nscale = 0.5\n'
        '[keypoints]\nElbow = "FL_SHOULDER"\n[contacts]\nFL_FOOT = ["Palm", "Wrist"]\n'
    )
    skeleton = load_map(path)
    assert (skeleton.name, skeleton.up_axis, skeleton.unit, skeleton.scale) == (
        "arm",
        "-z",
        1.0,
        "0.5",
    )
    assert skeleton.contacts == {"FL_FOOT": ("Palm", "Wrist")}
    assert skeleton.missing(["Palm"]) == ["Elbow"]


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"robot": None}, "'robot' is missing"),
        ({"up_axis": "up"}, "up_axis 'up'"),
        ({"scale": "legs"}, "scale 'legs'; use limbs, height"),
        ({"scale": -1}, "scale '-1'"),
        ({"unit": "cm"}, "'unit'"),
        ({"keypoint": {}}, "unknown key 'keypoint'"),
        ({"keypoints": {"A": "FL_FOOT", "B": "FL_FOOT"}}, "twice"),
        ({"keypoints": {"A": 1}}, "frames of the robot"),
        ({"contacts": {"FL_FOOT": []}}, "contacts"),
    ],
)
def test_a_wrong_map_is_one_line_that_names_file_and_key(change, words):
    with pytest.raises(StageError, match=words) as caught:
        map_of({**TABLE, **change}, "arm", "maps/arm.toml")
    assert str(caught.value).startswith("maps/arm.toml: ")


def test_files_that_are_no_map(tmp_path):
    with pytest.raises(StageError, match=r"gone\.toml: cannot be read"):
        load_map(tmp_path / "gone.toml")
    (tmp_path / "bad.toml").write_text("= 3")
    with pytest.raises(StageError, match=r"bad\.toml: not a TOML file"):
        load_map(tmp_path / "bad.toml")


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"keypoints": {"A": "FL_PAW"}}, r"\[keypoints\] names 'FL_PAW'"),
        ({"contacts": {"FL_SHOULDER": "A"}}, r"\[contacts\] names 'FL_SHOULDER'"),
    ],
)
def test_a_frame_that_the_robot_has_not_is_named(change, words):
    skeleton = map_of({**TABLE, **change}, "arm", "arm.toml")
    with pytest.raises(StageError, match=words):
        mapped(load_robot("solo12"), skeleton)


def test_a_misspelt_node_that_should_touch_the_ground_is_named():
    """It is not passed over in silence, as an end that the file leaves out is."""
    known = next(one for one in shipped_maps() if one.name == "mann-dog")
    dog = load_bvh(DOG_BVH)
    for names, sound in (
        (("LeftHand_ned", "LeftHand"), False),
        (("LeftHand_ned",), False),
        (("LeftHand_end",), True),
        (("front_toe.L", "LeftHand"), True),
    ):
        skeleton = replace(known, contacts={**known.contacts, "FL_FOOT": names})
        feet = body_map(mapped(load_robot("solo12"), skeleton), skeleton.contacts)
        if sound:
            assert feet.limb_ends(dog)[0] in ("LeftHand", "LeftHand_end")
        else:
            with pytest.raises(DatasetError, match="no joint 'LeftHand_ned'; did you mean"):
                feet.limb_ends(dog)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (
            'robot = "r"\n[keypoints]\na = "b"\n[contacts]\nfoot = 0.5\n',
            "[contacts] gives each foot",
        ),
        ('robot = "r"\n[keypoints]\na = "b"\n[contacts]\nfoot = {x = 1}\n', "[contacts] gives"),
        ("a = " + "[" * 5000, "lie too deep"),
        ("a = " + "{a=" * 5000, "lie too deep"),
        ("a = " + "9" * 6000, "not a TOML file"),
    ],
)
def test_a_map_of_another_form_is_refused_in_one_line(tmp_path, text, words):
    path = tmp_path / "map.toml"
    path.write_text(text)
    with pytest.raises(StageError) as caught:
        load_map(path)
    assert words in str(caught.value) and str(path) in str(caught.value)
    assert "\n" not in str(caught.value)
