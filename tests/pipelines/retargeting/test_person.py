"""A person's motion on the H1: upright, feet rolled and planted, knees and elbows the right way."""

from dataclasses import replace

import numpy as np
import pytest

from lacoloco.datasets import rotations
from lacoloco.datasets.errors import DatasetError
from lacoloco.datasets.mocap import load_bvh, read_bvh
from lacoloco.datasets.samples import DOG_BVH, HUMAN_BVH, human_gait, make_human
from lacoloco.pipelines.errors import StageError
from lacoloco.pipelines.retargeting.config import RetargetConfig
from lacoloco.pipelines.retargeting.mocap.body_map import body_map, leg_geometry
from lacoloco.pipelines.retargeting.mocap.posture import unlike
from lacoloco.pipelines.retargeting.mocap.skeleton_maps import (
    choose_map,
    map_of,
    other_robot,
    sample_for,
    shipped_maps,
)
from lacoloco.pipelines.retargeting.mocap.soles import recorded_feet
from lacoloco.pipelines.retargeting.retargeter import mapped
from lacoloco.pipelines.retargeting.worker import Task, Worker
from lacoloco.robots.registry import load_robot

JOINTS = read_bvh(HUMAN_BVH).joint_names
MAPS = shipped_maps()
SKELETON = choose_map(MAPS, "h1", JOINTS, "person.bvh")
SPEC = mapped(load_robot("h1"), SKELETON)
BODY = body_map(SPEC)
SIDES = ("Left", "Right")
SECONDS = "0s:3s"


def retargeted(mode, path=HUMAN_BVH, **options):
    worker = Worker(RetargetConfig(mode=mode, trim=SECONDS, **options), "h1")
    mocap, _, retargeter, findings = worker.read(Task(path, "person"))
    return retargeter.clip(mocap, "person"), mocap, findings


@pytest.fixture(scope="module")
def walk():
    return retargeted("clip")


def test_the_bundled_person_fits_the_h1_and_the_bundled_dog_the_solo12():
    assert SKELETON.name == "human"
    assert sample_for("h1", MAPS) == HUMAN_BVH
    assert sample_for("solo12", MAPS) == DOG_BVH


@pytest.mark.parametrize(
    ("name", "rename", "more"),
    [
        ("lafan1", {f"{side}ToeBase": f"{side}Toe" for side in SIDES}, ()),
        ("mixamo", {joint: f"mixamorig:{joint}" for joint in JOINTS}, ()),
        ("cmu", {}, ("LHipJoint", "RHipJoint")),
    ],
)
def test_skeletons_are_told_by_their_joints(name, rename, more):
    joints = [*(rename.get(joint, joint) for joint in JOINTS), *more]
    assert choose_map(MAPS, "h1", joints, "person.bvh").name == name


def test_a_file_with_other_names_gives_the_same_clip(tmp_path, walk):
    rename = {f"{side}ToeBase": f"{side}Toe" for side in SIDES}
    path = make_human.make(tmp_path / "person.bvh", rename=rename)
    other, _, _ = retargeted("clip", path)
    np.testing.assert_array_equal(other.clip.joint_pos, walk[0].clip.joint_pos)


def test_a_persons_heels_follow_from_ankles_and_toes():
    mocap = load_bvh(HUMAN_BVH)
    times = np.arange(mocap.frames) / mocap.fps
    feet = recorded_feet(mocap.keypoints(BODY.feet), mocap.keypoints(BODY.hips), BODY.soles)
    share = BODY.soles[0].behind / (BODY.soles[0].length - BODY.soles[0].behind)
    for index, side in enumerate(SIDES):
        truth = human_gait.foot(side, times)
        np.testing.assert_allclose(feet.pitch[:, index], truth.pitch, atol=0.01)
        # as far behind the ankle as the robot's heel is, and as high as the joint of the toes
        back, down = share * human_gait.BALL[0], human_gait.ANKLE - human_gait.BALL[1]
        height = truth.ankle[:, 2] - np.sin(truth.pitch) * back - np.cos(truth.pitch) * down
        np.testing.assert_allclose(feet.heels[:, index, 2], height, atol=0.002)


def test_feet_are_planted_where_the_persons_stand(walk):
    result, mocap, findings = walk
    metrics = result.metrics()
    assert findings == [] and result.failures == 0
    assert metrics["keypoint_error_mean_m"] < 0.01
    assert metrics["foot_skate_mean_m_s"] < 0.001
    assert metrics["ground_penetration_max_m"] < 1e-3
    assert metrics["body_penetration_max_m"] == 0.0
    assert metrics["stance_float_max_m"] < 1e-3
    assert metrics["joint_limit_hits"] == metrics["joint_speed_hits"] == 0
    times = np.arange(mocap.frames) / mocap.fps
    truth = np.stack([s for side in SIDES for s in human_gait.stance(side, times)], axis=1)
    assert (result.assessment.contacts == truth).mean() > 0.9, "heels rise slowly"
    assert result.clip.contacts.shape == (mocap.frames, 2)
    assert result.clip.contacts.any(axis=1).all(), "who walks always stands on a foot"


def test_the_robot_is_upright_and_its_joints_bend_as_a_persons(walk):
    clip = walk[0].clip
    up = rotations.rotate(clip.root_quat, np.array([0.0, 0.0, 1.0]))
    assert up[:, 2].min() > np.cos(0.2)
    names = list(SPEC.joint_names)
    for side in ("left", "right"):
        knee = clip.joint_pos[:, names.index(f"{side}_knee")]
        assert knee.min() > 0.1 and np.ptp(knee) > 0.5
        shoulder = clip.joint_pos[:, names.index(f"{side}_shoulder_pitch")]
        hip = clip.joint_pos[:, names.index(f"{side}_hip_pitch")]
        assert np.corrcoef(shoulder, hip)[0, 1] < -0.7, "arms swing against the legs"
    ahead = clip.root_pos[-1] - clip.root_pos[0]
    forward = rotations.rotate(clip.root_quat, np.array([1.0, 0.0, 0.0]))[0]
    assert ahead @ forward > 0.95 * np.linalg.norm(ahead), "it walks forward"


def test_the_papers_mode_follows_the_person_in_its_own_size():
    result, mocap, _ = retargeted("paper")
    metrics = result.metrics()
    assert metrics["scale"] == 1.0 and result.failures == 0
    # The H1's hips are twice as far apart as a person's; nothing is fitted in this mode.
    assert metrics["keypoint_error_mean_m"] < 0.06
    assert metrics["ground_penetration_max_m"] < 1e-3
    targets = result.assessment.targets.points
    np.testing.assert_array_equal(
        targets[:, BODY.hip_keypoints], mocap.keypoints(["LeftUpLeg", "RightUpLeg"])
    )


def test_a_mirrored_person_steps_with_the_other_foot_and_swings_the_other_arm(walk):
    image, _, _ = retargeted("clip", mirror=True)
    np.testing.assert_array_equal(
        image.assessment.targets.contacts[:, [2, 3, 0, 1]], walk[0].assessment.targets.contacts
    )
    names = list(SPEC.joint_names)
    left, right = (names.index(f"{side}_shoulder_pitch") for side in ("left", "right"))
    np.testing.assert_allclose(
        image.clip.joint_pos[:, left], walk[0].clip.joint_pos[:, right], atol=0.02
    )


def test_the_wrong_unit_is_named():
    with pytest.raises(DatasetError, match="no person's.*centimetres: give --unit 0.01"):
        retargeted("clip", unit=0.0254)


def test_a_person_upside_down_or_with_sides_exchanged_is_named():
    with pytest.raises(DatasetError, match="upside down.*--up-axis=y"):
        retargeted("clip", up_axis="-y")
    _, _, findings = retargeted("paper", swap_sides=True)
    assert "sides_swapped" in [finding.name for finding in findings]


def test_a_person_is_not_taken_for_a_dog():
    worker = Worker(RetargetConfig(), "solo12")
    with pytest.raises(DatasetError, match="trunk stands.*map 'human': --robot h1"):
        worker.read(Task(HUMAN_BVH, "person"))
    dog = next(skeleton for skeleton in MAPS if skeleton.name == "mann-dog")
    assert other_robot(MAPS, dog, read_bvh(DOG_BVH).joint_names) is None


def test_a_dog_is_not_taken_for_a_person():
    """A dog whose toes are named as a person's."""
    mocap = load_bvh(DOG_BVH)
    rename = {f"{side}Foot_end": f"{side}ToeBase" for side in SIDES}
    names = tuple(rename.get(name, name) for name in mocap.joint_names)
    reason = unlike(replace(mocap, joint_names=names), BODY, leg_geometry(SPEC, BODY))
    assert reason is not None and "hands are near the ground" in reason


def test_maps_that_cannot_do_are_refused_in_a_line():
    table = {
        "robot": "h1",
        "keypoints": {"LeftUpLeg": "left_hip_pitch_link", "LeftFoot": "left_FOOT"},
    }
    robot = load_robot("h1")
    contacts = {**table, "contacts": {"left_FOOT": ["LeftToeBase"]}}
    with pytest.raises(StageError, match=r"leave \[contacts\] out; h1 stands on heels and toes"):
        mapped(robot, map_of(contacts, "own", "own.toml"))
    with pytest.raises(StageError, match="keypoints for left_heel"):
        body_map(mapped(robot, map_of(table, "own", "own.toml")))
    legs = {j: f for j, f in SKELETON.keypoints.items() if "Arm" not in j and "Hand" not in j}
    with pytest.raises(StageError, match="two legs do not tell how the trunk stands"):
        body_map(replace(robot, keypoints=legs))


def test_feet_of_one_point_do_for_two_legs_too():
    """As of a robot whose robot.toml names no heels and toes."""
    robot = replace(load_robot("h1"), soles={}, points={})
    keypoints = {
        "Hips": "pelvis",
        **{f"{side}UpLeg": f"{side.lower()}_hip_pitch_link" for side in SIDES},
        **{f"{side}ToeBase": f"{side.lower()}_FOOT" for side in SIDES},
        **{f"{side}Arm": f"{side.lower()}_shoulder_roll_link" for side in SIDES},
        **{f"{side}Hand": f"{side.lower()}_elbow_link" for side in SIDES},
    }
    body = body_map(replace(robot, keypoints=keypoints))
    assert body.hips == ("LeftUpLeg", "RightUpLeg") and body.legs == (0, 1)
    assert [[body.joints[k] for k in arm] for arm in body.arms] == [
        ["Hips"],
        ["LeftArm", "LeftHand"],
        ["RightArm", "RightHand"],
    ]
