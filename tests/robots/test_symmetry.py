"""The mirror image of a robot."""

import re

import mujoco
import numpy as np
import pytest

from lacoloco.robots.errors import RobotError
from lacoloco.robots.loading import robot_from_files
from lacoloco.robots.symmetry import sagittal_symmetry

MIRROR = np.array([1.0, -1.0, 1.0])


def test_the_mirrored_pose_is_the_mirror_image(robot):
    """Every link of the mirrored pose lies where its counterpart's reflection does."""
    model, symmetry = robot.model(), sagittal_symmetry(robot)
    data, image = mujoco.MjData(model), mujoco.MjData(model)
    data.qpos[:7] = image.qpos[:7] = [0, 0, 0, 1, 0, 0, 0]
    data.qpos[7:] = np.random.default_rng(0).uniform(-0.4, 0.4, robot.num_joints)
    image.qpos[7:] = np.array(symmetry.signs) * data.qpos[7:][list(symmetry.joints)]
    mujoco.mj_kinematics(model, data)
    mujoco.mj_kinematics(model, image)
    mirrored = data.xanchor[1:][list(symmetry.joints)] * MIRROR
    np.testing.assert_allclose(image.xanchor[1:], mirrored, atol=1e-4)


def test_mirroring_twice_changes_nothing(robot):
    symmetry = sagittal_symmetry(robot)
    order, signs = np.array(symmetry.joints), np.array(symmetry.signs)
    assert (order[order] == np.arange(robot.num_joints)).all()
    assert (signs * signs[order] == 1.0).all()


def test_names_of_the_h1_say_the_same(h1):
    pairs = zip(h1.joint_names, sagittal_symmetry(h1).joints, strict=True)
    swapped = {"left": "right", "right": "left"}
    for name, other in pairs:
        assert h1.joint_names[other] == re.sub("left|right", lambda m: swapped[m[0]], name)


def test_unequal_sides_are_refused_by_the_joint(h1):
    files = h1.files()
    text = files["h1.xml"].replace(
        '<body name="left_knee_link" pos="0 0 -0.4">',
        '<body name="left_knee_link" pos="0 0 -0.45">',
    )
    with pytest.raises(RobotError, match="left_knee.*counterpart"):
        sagittal_symmetry(robot_from_files({**files, "h1.xml": text}))
