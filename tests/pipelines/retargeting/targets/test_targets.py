from dataclasses import replace

import numpy as np
import pytest

from lacoloco.datasets import rotations
from lacoloco.datasets.errors import DatasetError
from lacoloco.datasets.mocap import Mocap, load_bvh
from lacoloco.datasets.samples import DOG_BVH
from lacoloco.pipelines.errors import StageError
from lacoloco.pipelines.retargeting.mocap.body_map import body_map, bone_length, leg_geometry
from lacoloco.pipelines.retargeting.targets.targets import (
    fitted_targets,
    natural_scale,
    plain_targets,
)
from lacoloco.robots.registry import load_robot

SPEC = load_robot("solo12")
MAP = body_map(SPEC)
LEGS = leg_geometry(SPEC, MAP)
RADIUS = SPEC.foot_radius()


@pytest.fixture(scope="module")
def dog():
    return load_bvh(DOG_BVH)


def fitted(mocap, **options):
    return fitted_targets(mocap, MAP, LEGS, RADIUS, **options)


def moved(mocap, turn=0.0, shift=(0.0, 0.0, 0.0), size=1.0):
    quat = rotations.from_yaw(np.array(turn))
    points = rotations.rotate(quat[None, None], size * mocap.positions) + np.array(shift)
    return Mocap(mocap.name, mocap.fps, mocap.joint_names, mocap.parents, points)


def test_hips_and_feet_of_the_robot_are_paired_leg_by_leg():
    assert MAP.hips == ("LeftShoulder", "RightShoulder", "LeftUpLeg", "RightUpLeg")
    assert MAP.feet == ("LeftHand", "RightHand", "LeftFoot", "RightFoot")
    bodies = list(SPEC.keypoints.values())
    assert [bodies[i] for i in MAP.foot_keypoints] == list(SPEC.feet)


def test_the_reach_of_a_leg_is_that_of_its_links():
    # two links of 0.16 m in one plane, 0.05945 m beside the hip
    assert LEGS.reach == pytest.approx(np.hypot(0.32, 0.014 + 0.03745 + 0.008), rel=1e-6)


def test_a_robot_without_keypoints_at_its_feet_is_refused():
    with pytest.raises(StageError, match="h1.*keypoints for left_heel"):
        body_map(load_robot("h1"))


def test_plain_targets_are_the_animal_itself(dog):
    targets = plain_targets(dog, MAP)
    np.testing.assert_array_equal(targets.points, dog.keypoints(list(SPEC.keypoints)))
    assert targets.scale == 1.0


def test_hips_are_those_of_the_robot(dog):
    points = fitted(dog).points[:, MAP.hip_keypoints]
    for a in range(4):
        for b in range(a):
            distance = np.linalg.norm(points[:, a] - points[:, b], axis=1)
            np.testing.assert_allclose(distance, np.linalg.norm(LEGS.hips[a] - LEGS.hips[b]))


def test_standing_feet_are_on_the_ground_whatever_the_height_of_the_floor(dog):
    """Bug B6: the original's foot centres are on the ground, and so its foot spheres in it."""
    for shift in (0.0, 0.3):
        targets = fitted(moved(dog, shift=(0, 0, shift)))
        height = targets.points[:, MAP.foot_keypoints, 2][targets.contacts]
        assert np.abs(height - RADIUS).max() < 0.005


def test_fitting_follows_the_animal_wherever_it_is_and_looks(dog):
    targets, other = fitted(dog), fitted(moved(dog, turn=2.0, shift=(3.0, -1.0, 0.0)))
    quat = rotations.from_yaw(np.array(2.0))
    turned = rotations.rotate(quat[None, None], targets.points)
    turned += targets.scale * np.array([3.0, -1.0, 0.0])
    np.testing.assert_allclose(other.points, turned, atol=1e-9)
    np.testing.assert_array_equal(other.contacts, targets.contacts)


def test_a_bigger_animal_is_scaled_down_to_the_same_legs(dog):
    small, big = (fitted(moved(dog, size=size)) for size in (1.0, 1.5))
    assert big.scale == pytest.approx(small.scale / 1.5)
    assert 0.6 < small.scale < 0.9


def test_scaled_legs_bend_and_stand_apart(dog):
    targets = fitted(dog)
    hips, feet = (targets.points[:, columns] for columns in (MAP.hip_keypoints, MAP.foot_keypoints))
    stretch = np.linalg.norm(hips - feet, axis=-1)[targets.contacts] / LEGS.reach
    assert 0.7 < np.median(stretch) < 0.95
    # left feet lie left of right feet, about as far apart as below the robot's own hips
    left = targets.points[:, MAP.foot_keypoints[0]] - targets.points[:, MAP.foot_keypoints[1]]
    apart = np.median(np.linalg.norm(left[:, :2], axis=1))
    assert apart == pytest.approx(LEGS.feet[0, 1] - LEGS.feet[1, 1], abs=0.08)


def test_a_scale_that_is_given_is_taken(dog):
    assert fitted(dog, scale=0.5).scale == 0.5


def test_a_tall_animal_does_not_stretch_the_robot(dog):
    tall = moved(dog)
    tall.positions[:, [dog.joint_names.index(name) for name in MAP.hips], 2] += 0.3
    assert natural_scale(tall, MAP, LEGS, RADIUS) < natural_scale(dog, MAP, LEGS, RADIUS)


def test_a_limb_is_as_long_as_its_bones(dog):
    limb = MAP.limbs(dog)[2]
    assert limb == ("LeftUpLeg", "LeftLeg", "LeftFoot", "LeftFoot_end")
    bones = np.linalg.norm(np.diff(dog.keypoints(limb)[0], axis=0), axis=1)
    assert bone_length(dog, limb) == pytest.approx(bones.sum(), abs=1e-6)


def test_a_foot_that_is_not_below_its_hip_is_a_mistake_of_the_map(dog):
    wrong = replace(MAP, hips=("RightShoulder", *MAP.hips[1:]))
    with pytest.raises(DatasetError, match="'LeftHand_end' is not below 'RightShoulder'"):
        wrong.limbs(dog)


def test_by_height_limbs_do_not_count(dog):
    tall = natural_scale(dog, MAP, LEGS, RADIUS, "height")
    paws = dog.keypoints(MAP.limb_ends(dog))[..., 2].min()
    hips = np.percentile(dog.keypoints(MAP.hips)[..., 2].mean(1), 90) - paws
    assert tall * hips == pytest.approx(0.9 * (LEGS.reach + RADIUS), rel=0.02)


def test_without_ends_of_limbs_the_joints_are_taken(dog):
    keep = [i for i, name in enumerate(dog.joint_names) if not name.endswith("_end")]
    parents = tuple(keep.index(dog.parents[i]) if dog.parents[i] >= 0 else -1 for i in keep)
    names = tuple(dog.joint_names[i] for i in keep)
    bare = Mocap(dog.name, dog.fps, names, parents, dog.positions[:, keep])
    assert MAP.limb_ends(bare) == MAP.feet
    assert np.isfinite(fitted(bare).points).all()


def test_a_missing_hip_is_named(dog):
    names = tuple("Hip" if name == "LeftUpLeg" else name for name in dog.joint_names)
    other = Mocap(dog.name, dog.fps, names, dog.parents, dog.positions)
    with pytest.raises(DatasetError, match="LeftUpLeg"):
        fitted(other)
