import hashlib
from dataclasses import replace
from math import cos, pi

import numpy as np
import pytest

from lacoloco.robots.loading import robot_from_files
from lacoloco.robots.spec import EndEffector


def test_sizes_of_solo12(solo12):
    assert solo12.total_mass() == pytest.approx(2.50000279, abs=1e-8)
    assert solo12.weight() == pytest.approx(2.50000279 * 9.81, abs=1e-6)
    assert solo12.foot_force_limit() == solo12.weight()
    assert solo12.foot_radius() == 0.02
    # thigh and shank, 16 cm each, both 0.4 rad off the vertical, and the foot sphere
    assert solo12.default_height() == pytest.approx(2 * 0.16 * cos(0.4) + 0.02, abs=1e-12)


def test_sizes_of_h1(h1):
    assert h1.total_mass() == pytest.approx(51.437, abs=1e-9)
    assert h1.foot_force_limit() == pytest.approx(1.5 * 51.437 * 9.81, abs=1e-6)
    assert h1.foot_radius() == 0.014
    assert 0.9 < h1.default_height() < 1.06  # below the height with straight legs


def test_numbers_of_solo12(solo12):
    legs = ("FL", "FR", "HL", "HR")
    assert solo12.joint_names == tuple(f"{i}_{j}" for i in legs for j in ("HAA", "HFE", "KFE"))
    assert solo12.default_joint_pos == (0.0, 0.4, -0.8) * 4
    assert solo12.effort_limits().tolist() == [3.0] * 12
    assert set(solo12.training_effort_limits) == {4.5}
    assert set(solo12.stiffness) == {4.0} and set(solo12.damping) == {0.2}
    assert set(solo12.velocity_limits) == {16.0}
    assert (solo12.action_scale, solo12.walk_action_scale) == (1.5, 0.5)
    assert solo12.end_effector == EndEffector("FR_FOOT")
    assert solo12.self_collision
    assert solo12.model().dof_armature[6:].tolist() == [3.6207e-4] * 12


def test_numbers_of_h1(h1):
    assert h1.num_joints == 19
    assert h1.end_effector == EndEffector("right_elbow_link", (0.3, 0.0, 0.0))
    assert not h1.self_collision
    effort = dict(zip(h1.joint_names, h1.effort_limits(), strict=True))
    assert (effort["left_knee"], effort["right_ankle"], effort["left_elbow"]) == (300, 60, 18)
    assert h1.model().dof_damping[6:].tolist() == [1.0] * 19
    lower, upper = h1.joint_limits()
    upper[[joint.endswith("_elbow") for joint in h1.joint_names]] = 1.5  # a straight arm is pi/2
    assert h1.retarget_lower == pytest.approx(lower)
    assert h1.retarget_upper == pytest.approx(upper)
    assert h1.foot_points == ("left_heel", "left_toes", "right_heel", "right_toes")
    assert h1.foot_of_point == (0, 0, 1, 1)


def test_joint_ranges_of_solo12_mirror_front_and_hind_left_and_right(solo12):
    lower, upper = (limit.reshape(4, 3) for limit in solo12.joint_limits())
    np.testing.assert_array_equal(lower[[0, 2], 0], -upper[[1, 3], 0])  # HAA, left and right
    np.testing.assert_array_equal(lower[:2, 1], -upper[2:, 1])  # HFE, front and hind


def test_retargeting_of_solo12(solo12):
    assert solo12.retarget_neutral == (0.0, pi / 4, -pi / 2) * 4
    assert len(solo12.keypoints) == 8 and solo12.keypoints["RightHand"] == "FR_FOOT"
    bounds = list(zip(solo12.retarget_lower, solo12.retarget_upper, strict=True))
    assert bounds[:2] == [(-pi / 4, pi / 2), (-5 * pi / 4, pi / 2)]  # FL_HAA, FL_HFE
    assert bounds[9:11] == [(-pi / 2, pi / 4), (-pi / 2, 5 * pi / 4)]  # HR_HAA, HR_HFE


def test_feet_and_shoulders_of_solo12_stand_where_they_should(solo12):
    import mujoco

    data = mujoco.MjData(solo12.model())
    data.qpos[:] = solo12.default_qpos()
    mujoco.mj_kinematics(solo12.model(), data)
    for leg, x, y in (("FL", 1, 1), ("FR", 1, -1), ("HL", -1, 1), ("HR", -1, -1)):
        foot = [0.1946 * x, (0.0875 + 0.014 + 0.03745 + 0.008) * y, 0.02]
        np.testing.assert_allclose(data.body(f"{leg}_FOOT").xpos, foot, atol=1e-12)
        shoulder = data.body(f"{leg}_SHOULDER").xpos[:2]
        np.testing.assert_allclose(shoulder, [0.1946 * x, 0.0875 * y], atol=1e-12)


def test_contact_bodies_come_once_and_feet_first(solo12, h1):
    assert solo12.contact_bodies[:5] == (*solo12.feet, "base_link")
    assert len(solo12.contact_bodies) == 9
    twice = replace(h1, undesired_contact_bodies=("torso_link", "left_knee_link"))
    assert twice.contact_bodies == ("left_FOOT", "right_FOOT", "torso_link", "left_knee_link")


def test_model_hash_is_of_the_bytes(solo12):
    assert solo12.model_hash() == hashlib.sha256(solo12.mjcf.read_bytes()).hexdigest()
    files = solo12.files()
    files["solo12.xml"] += "\n"
    assert robot_from_files(files).model_hash() != solo12.model_hash()


def test_specs_can_be_hashed(solo12, h1):
    assert len({solo12, h1, solo12}) == 2
