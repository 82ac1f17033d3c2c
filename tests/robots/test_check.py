from dataclasses import replace

import pytest

from lacoloco.robots.check import Check, check_robot
from lacoloco.robots.errors import RobotError


@pytest.fixture
def edited(solo12, tmp_path):
    """Solo12 with one text of its MJCF replaced."""

    def edit(old, new):
        text = solo12.mjcf.read_text()
        assert old in text
        path = tmp_path / "edited.xml"
        path.write_text(text.replace(old, new))
        return replace(solo12, mjcf=path)

    return edit


def failed(spec):
    return [check.name for check in check_robot(spec, poses=2).failures()]


def value(report, name):
    return next(check.value for check in report.checks if check.name == name)


def test_the_engines_agree_to_machine_precision(robot):
    report = check_robot(robot)
    assert report.passed, report.failures()
    assert value(report, "positions, MuJoCo - Pinocchio") < 1e-12
    assert value(report, "rotations, MuJoCo - Pinocchio") < 1e-12
    assert value(report, "mass matrix, MuJoCo - Pinocchio") < 1e-10
    assert report.model_hash == robot.model_hash()


def test_a_body_whose_mass_is_guessed_from_its_shape_is_found(edited):
    names = failed(edited('<geom density="0"', '<geom mass="0"'))
    assert names == []  # every body of Solo12 has its inertial
    foot = '<inertial pos="0 0 0.00035767" mass="0.00693606"\n'
    foot += " " * 24 + 'fullinertia="0.00000057 0.00000084 0.00000053 0 0 0"/>'
    bare = edited(foot, "")
    text = bare.mjcf.read_text().replace('<geom density="0"', '<geom mass="0"')
    bare.mjcf.write_text(text)
    assert "total mass, MuJoCo - Pinocchio" in failed(bare)


@pytest.mark.parametrize(
    ("old", "new", "name"),
    [
        ("0.31473951808 1 0 0 0\n", "0.3 1 0 0 0\n", "keyframe - default pose"),
        (' actuatorfrcrange="-3 3"', "", "joints without effort limit"),
        (
            'size="0.224 0.06 0.028"',
            'size="0.224 0.06 0.4"',
            "touching in the default pose, but no foot",
        ),
    ],
)
def test_mistakes_in_the_mjcf_are_found(edited, old, new, name):
    assert name in failed(edited(old, new))


@pytest.mark.parametrize(
    ("change", "name"),
    [
        ({"default_joint_pos": (1.6, 0.4, -0.8) * 4}, "default pose beyond limits"),
        ({"retarget_upper": (3.0,) * 12}, "retarget bounds beyond limits"),
        ({"retarget_neutral": (-2.0, 0.0, 0.0) * 4}, "neutral pose beyond bounds"),
        ({"training_effort_limits": (2.0,) * 12}, "motor torque beyond training torque"),
        ({"stiffness": (0.0,) * 12}, "gains not positive"),
        ({"velocity_limits": (float("nan"),) * 12}, "speed limits not positive"),
        (
            {"default_joint_pos": (0.0, 0.4, -0.8) * 3 + (0.0, 1.0, -0.8)},
            "feet in the air in the default pose",
        ),
    ],
)
def test_mistakes_in_the_spec_are_found(solo12, change, name):
    assert name in failed(replace(solo12, **change))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"stiffness": (4.0,) * 11}, "stiffness has 11 values for 12 joints"),
        ({"feet": ("FL_FOOT", "PAW")}, "missing: PAW"),
        ({"keypoints": {"Tail": "TAIL"}}, "missing: TAIL"),
        ({"feet": ("FL_LOWER_LEG",)}, r"\*_FOOT: FL_LOWER_LEG"),
    ],
)
def test_a_robot_too_broken_to_compare_is_refused(solo12, change, message):
    with pytest.raises(RobotError, match=message):
        check_robot(replace(solo12, **change))


def test_joints_in_another_order_are_refused(solo12):
    names = (*solo12.joint_names[3:6], *solo12.joint_names[:3], *solo12.joint_names[6:])
    with pytest.raises(RobotError, match="FR_HAA where the MJCF has FL_HAA"):
        check_robot(replace(solo12, joint_names=names))


def test_nan_does_not_pass():
    assert not Check("x", float("nan"), 1.0).passed
