"""Every mistake in a robot's folder is one line that names file, key and what is expected."""

import pickle
import shutil

import pytest

from lacoloco.robots.errors import RobotError
from lacoloco.robots.loading import load_folder, robot_from_files


def test_a_robot_outlives_its_folder(robot_folder, solo12):
    files = load_folder(robot_folder).files()
    shutil.rmtree(robot_folder)
    spec = robot_from_files(files, robot_folder)
    assert spec.files() == files == solo12.files()
    assert spec.folder == robot_folder
    assert spec.model().nbody == solo12.model().nbody
    assert spec.pinocchio_model().nq == 19
    assert (spec.model_hash(), spec.weight()) == (solo12.model_hash(), solo12.weight())
    assert pickle.loads(pickle.dumps(spec)) == spec
    assert robot_from_files(files).stiffness == spec.stiffness


def test_a_robot_keeps_the_text_it_was_read_from(robot_folder, solo12):
    spec = load_folder(robot_folder)
    xml = robot_folder / "solo12.xml"
    xml.write_text(xml.read_text().replace('mass="1.16115091"', 'mass="9"'))
    assert spec.total_mass() == solo12.total_mass()
    assert load_folder(robot_folder).total_mass() > 9


def test_what_retargeting_leaves_out_follows_from_the_robot(solo12):
    toml = solo12.files()["robot.toml"]
    before, after = toml.split("[retargeting]")
    toml = before + after[after.index("[observation_noise]") :]
    spec = robot_from_files({**solo12.files(), "robot.toml": toml})
    assert spec.retarget_neutral == spec.default_joint_pos
    assert spec.retarget_upper == tuple(solo12.joint_limits()[1])
    assert (dict(spec.keypoints), spec.knee_frames) == ({}, ())


def test_a_row_of_a_joint_goes_before_those_of_patterns(solo12):
    toml = solo12.files()["robot.toml"]
    toml = toml.replace("[joints]", "[joints]\nFR_KFE = { stiffness = 9, default = -1.0 }")
    spec = robot_from_files({**solo12.files(), "robot.toml": toml})
    assert spec.stiffness == (4.0,) * 5 + (9.0,) + (4.0,) * 6
    assert spec.default_joint_pos == (0.0, 0.4, -0.8, 0.0, 0.4, -1.0) + (0.0, 0.4, -0.8) * 2


ROW = '"*" = { stiffness = 4.0, damping = 0.2, training_effort = 4.5, speed = 16.0 }'
MISTAKES = [
    ('name = "solo12"', "", "name: missing; expected a text"),
    ('name = "solo12"', "name = 12", "name: expected a text, found 12"),
    ('name = "solo12"', 'name = "a/b"', "name: expected letters, digits, '_', '-' and '.', found"),
    ('name = "solo12"', 'name = "solo12"\nmjcf = "../x.xml"', "mjcf: expected the name of a file"),
    ('name = "solo12"', 'name = "solo12"\ncolour = 1', "colour: unknown key; choose one of name"),
    ("[actions]", "[action]", "action: unknown key; did you mean 'actions'?"),
    ("[contacts]", "[contacts", "not a TOML file: "),
    ("scale = 1.5 #", "scael = 1.5 #", "actions.scael: unknown key; did you mean 'scale'?"),
    ("scale = 1.5 #", "#", "actions.scale: missing; expected a number above 0"),
    ("scale = 1.5 #", "scale = 0 #", "actions.scale: expected a number above 0, found 0"),
    ("scale = 1.5 #", "scale = -1 #", "actions.scale: expected a number above 0, found -1"),
    ("reach_height = 0.15", "reach_height = 150", "skills.reach_height: expected a length in met"),
    ("training_tilt = 1.05", "training_tilt = 60", "terminations.training_tilt: expected an angl"),
    (
        "foot_force_limit = 1.0",
        "foot_force_limit = 25.0",
        "contacts.foot_force_limit: expected a",
    ),
    ("scale = 1.5 #", "scale = nan #", "actions.scale: expected a finite number, found nan"),
    ("scale = 1.5 #", "scale = inf #", "actions.scale: expected a finite number, found inf"),
    ("scale = 1.5 #", f"scale = {'9' * 400} #", "actions.scale: expected a finite number, found 9"),
    (
        "scale = 1.5 #",
        f"scale = 0x{'F' * 5000} #",
        "actions.scale: expected a finite number, found a number of too many digits",
    ),
    (
        "scale = 1.5 #",
        f"scale = {'[' * 120}{']' * 120} #",
        "actions.scale: expected a number, found [[[",
    ),
    ("scale = 1.5 #", "scale = true #", "actions.scale: expected a number, found true"),
    ("scale = 1.5 #", 'scale = "1" #', "actions.scale: expected a number, found '1'"),
    (
        "self_collision = true",
        "self_collision = 1",
        "contacts.self_collision: expected true or fal",
    ),
    ("self_collision = true", "", "contacts.self_collision: missing; expected true or false"),
    (
        '["base_link"]',
        '"base_link"',
        "contacts.fall_bodies: expected a list of names, found 'base_",
    ),
    ('["base_link"]', "[]", "contacts.fall_bodies: expected at least one body, found []"),
    ('["base_link"]', "[1]", "contacts.fall_bodies[0]: expected a text, found 1"),
    ('["base_link"]', '["base_lnik"]', "contacts.fall_bodies: body 'base_lnik' is not in the MJCF"),
    ('body = "FR_FOOT"', 'body = "PAW"', "end_effector.body: body 'PAW' is not in the MJCF"),
    (
        'body = "FR_FOOT"',
        'body = "FR_FOOT"\noffset = [0, 0]',
        "end_effector.offset: expected a list of 3 n",
    ),
    ('Hand = "FL_FOOT"', 'Hand = "LEFT"', "retargeting.keypoints: body 'LEFT' is not in the MJCF"),
    (
        "[retargeting.joints]",
        '[retargeting.points]\nheel = { body = "PAW" }\n[retargeting.joints]',
        "retargeting.points.heel.body: body 'PAW' is not in the MJCF",
    ),
    (
        "[retargeting.joints]",
        '[retargeting.points]\nFL_FOOT = { body = "FL_FOOT" }\n[retargeting.joints]',
        "retargeting.points.FL_FOOT: is the name of a body; choose another one",
    ),
    (
        "[retargeting.joints]",
        '[retargeting.soles]\nFL_FOOT = ["heel"]\n[retargeting.joints]',
        "retargeting.soles.FL_FOOT: expected the heel and the toes, two points of FL_FOOT",
    ),
    (ROW, ROW.replace("speed = 16.0", "sped = 16.0"), 'joints."*".sped: unknown key; did you mean'),
    (ROW, ROW.replace("16.0", "-1"), 'joints."*".speed: expected a number of at least 0, found -1'),
    (ROW, ROW.replace(", speed = 16.0", ""), "joints: no 'speed' for joint 'FL_HAA'"),
    (ROW, "'*' = 4.0", 'joints."*": expected a table, found 4.0'),
    ('"*_KFE" = { def', '"*_KEF" = { def', 'joints."*_KEF": no joint matches; '),
    (
        '"*_KFE" = { def',
        '"FL_*" = { def',
        "joints.\"FL_*\".default: '*_HAA' says it of joint 'FL_HAA'",
    ),
    ("[joints]", "[joint]", "joint: unknown key; did you mean 'joints'?"),
    (
        "range = [-10.0, 10.0]",
        "range = [10.0, -10.0]",
        'joints."*_KFE".range: expected two numbers, t',
    ),
    ("range = [-10.0, 10.0]", "range = [1.0]", 'joints."*_KFE".range: expected a list of 2 n'),
]


@pytest.mark.parametrize(("old", "new", "message"), MISTAKES, ids=[m[2][:40] for m in MISTAKES])
def test_a_mistake_in_the_toml_is_one_line(robot_folder, old, new, message):
    toml = robot_folder / "robot.toml"
    text = toml.read_text()
    assert old in text
    toml.write_text(text.replace(old, new, 1))
    with pytest.raises(RobotError) as error:
        load_folder(robot_folder)
    line = str(error.value)
    assert "\n" not in line
    assert line.startswith(f"{toml}: ")
    assert message in line


def test_a_missing_file_is_named(robot_folder):
    (robot_folder / "solo12.xml").unlink()
    with pytest.raises(RobotError, match=r"solo12\.xml: no such MJCF; write it, or set `mjcf`"):
        load_folder(robot_folder)
    (robot_folder / "robot.toml").unlink()
    with pytest.raises(RobotError, match="no robot there: a robot is a folder with robot.toml"):
        load_folder(robot_folder)


@pytest.mark.parametrize("missing", ["robot.toml", "solo12.xml"])
def test_a_missing_text_is_named(solo12, missing):
    files = {name: text for name, text in solo12.files().items() if name != missing}
    with pytest.raises(RobotError, match=f"{missing}: missing; "):
        robot_from_files(files)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("<mujoco><worldbody></mujoco>", r"solo12\.xml: MuJoCo cannot load it"),
        ("<mujoco/>", "the first joint must be the free joint 'root_joint'"),
        (
            '<mujoco><worldbody><body name="a"><freejoint/></body></worldbody></mujoco>',
            r"solo12\.xml",
        ),
    ],
)
def test_a_malformed_mjcf_is_named(robot_folder, text, message):
    (robot_folder / "solo12.xml").write_text(text)
    with pytest.raises(RobotError, match=message) as error:
        load_folder(robot_folder)
    assert "\n" not in str(error.value)


def test_a_file_that_is_no_text_is_named(robot_folder):
    (robot_folder / "robot.toml").write_bytes(b"\xff\xfe")
    with pytest.raises(RobotError, match=r"robot\.toml: cannot be read as text"):
        load_folder(robot_folder)
