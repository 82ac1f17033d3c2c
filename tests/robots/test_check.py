from dataclasses import replace

import numpy as np
import pytest

from lacoloco.robots.check import check_robot
from lacoloco.robots.errors import RobotError
from lacoloco.robots.finding import Check
from lacoloco.robots.loading import load_folder, robot_from_files


@pytest.fixture
def edited(solo12):
    """Solo12 with texts of its MJCF replaced, one after the other."""

    def edit(*replacements):
        files = solo12.files()
        for old, new in replacements:
            assert old in files["solo12.xml"]
            files["solo12.xml"] = files["solo12.xml"].replace(old, new)
        return robot_from_files(files)

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


def test_a_body_may_have_the_name_of_a_joint(solo12):
    files = {name: text.replace("_FOOT", "_KFE") for name, text in solo12.files().items()}
    assert failed(robot_from_files(files)) == []


def test_a_body_whose_mass_is_guessed_from_its_shape_is_found(edited):
    massless = ('<geom density="0"', '<geom mass="0"')
    assert failed(edited(massless)) == []  # every body of Solo12 has its inertial
    foot = '<inertial pos="0 0 0.00035767" mass="0.00693606"\n'
    foot += " " * 24 + 'fullinertia="0.00000057 0.00000084 0.00000053 0 0 0"/>'
    assert "total mass, MuJoCo - Pinocchio" in failed(edited((foot, ""), massless))


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
    assert name in failed(edited((old, new)))


JOINTS, ROWS = "robot.toml: joints: ", "robot.toml: retargeting.joints: "


@pytest.mark.parametrize(
    ("change", "name", "problem"),
    [
        (
            {"default_joint_pos": (1.6, 0.4, -0.8) * 4},
            "default pose beyond limits",
            JOINTS
            + "default of joint 'FR_HAA': expected -1.571 to 0.785 rad, its range in solo12.xml",
        ),
        (
            {"retarget_upper": (3.0,) * 12},
            "upper retarget bounds beyond limits",
            ROWS + "range of joint 'FR_HAA': expected -1.571 to 0.785 rad, its range in solo12.xml",
        ),
        (
            {"retarget_neutral": (-2.0, 0.0, 0.0) * 4},
            "neutral pose beyond bounds",
            ROWS + "neutral of joint 'FL_HAA': expected -0.7854 to 1.571 rad, its range of retarg",
        ),
        (
            {"training_effort_limits": (2.0,) * 12},
            "motor torque beyond training torque",
            JOINTS + "training_effort of joint 'FL_HAA': expected at least 3 N.m, the torque of it",
        ),
        (
            {"stiffness": (4.0,) * 11 + (0.0,)},
            "stiffness not positive",
            JOINTS + "stiffness of joint 'HR_KFE': expected a number above 0 N.m/rad; found 0",
        ),
        (
            {"velocity_limits": (float("nan"),) * 12},
            "speed not positive",
            JOINTS + "speed of joint 'FL_HAA': expected a number above 0 rad/s; found nan",
        ),
        (
            {"default_joint_pos": (0.0, 0.4, -0.8) * 3 + (0.0, 1.0, -0.8)},
            "feet in the air in the default pose",
            "robot.toml: contacts.feet: expected bodies on the floor in the default pose; HR_FOOT ",
        ),
    ],
)
def test_mistakes_in_the_spec_are_found_and_said_with_their_key(solo12, change, name, problem):
    checks = check_robot(replace(solo12, **change), poses=2).failures()
    found = {check.name: check.problem for check in checks}
    assert name in found
    assert str(solo12.folder) in found[name] and problem in found[name]
    assert "\n" not in found[name]


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"stiffness": (4.0,) * 11}, "stiffness has 11 values for 12 joints"),
        ({"feet": ("FL_FOOT", "PAW")}, "missing: PAW"),
        ({"keypoints": {"Tail": "TAIL"}}, "missing: TAIL"),
    ],
)
def test_a_robot_too_broken_to_compare_is_refused(solo12, change, message):
    with pytest.raises(RobotError, match=message):
        check_robot(replace(solo12, **change))


def test_joints_in_another_order_are_refused(solo12):
    names = (*solo12.joint_names[3:6], *solo12.joint_names[:3], *solo12.joint_names[6:])
    with pytest.raises(RobotError, match="FR_HAA where the MJCF has FL_HAA"):
        check_robot(replace(solo12, joint_names=names))


def test_meshes_may_be_looked_at_but_not_touched(solo12, robot_folder):
    shape = np.array([[0, 0, 0], [0.1, 0, 0], [0, 0.1, 0], [0, 0, 0.1]])
    faces = [(0, 2, 1), (0, 1, 3), (0, 3, 2), (1, 2, 3)]
    lines = [f"v {x} {y} {z}" for x, y, z in shape] + [
        f"f {a + 1} {b + 1} {c + 1}" for a, b, c in faces
    ]
    (robot_folder / "shell.obj").write_text("\n".join(lines))
    xml = robot_folder / "solo12.xml"
    text = xml.read_text().replace(
        "<worldbody>", '<asset><mesh file="shell.obj"/></asset><worldbody>', 1
    )
    geom = '<geom {}type="mesh" mesh="shell" pos="0 0 0.3"/><geom name="base_link"'
    for extra, expected in (('class="visual" ', []), ("", ["meshes that collide"])):
        xml.write_text(text.replace('<geom name="base_link"', geom.format(extra)))
        spec = load_folder(robot_folder)
        assert spec.model().nmesh == 1
        assert failed(spec) == expected
    carried = robot_from_files(spec.files(), robot_folder / "gone")
    assert carried.model().nmesh == 0
    assert carried.model().ngeom == solo12.model().ngeom
    assert carried.pinocchio_model().nq == 19
    assert carried.model_hash() == spec.model_hash()


def test_nan_does_not_pass():
    assert not Check("x", float("nan"), 1.0, "", "", "").passed
