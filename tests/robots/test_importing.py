"""A small quadruped of our own, written as people publish theirs, becomes a robot."""

from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest

from lacoloco.pipelines.sim.robot_tasks import check_tasks
from lacoloco.pipelines.sim.robot_trial import trial_checks
from lacoloco.robots.check import check_robot
from lacoloco.robots.errors import RobotError
from lacoloco.robots.importing.importer import import_robot
from lacoloco.robots.importing.meshes import best_primitive
from lacoloco.robots.registry import load_robot
from lacoloco.robots.stance import stand

LEG = """
<body name="{n}_hip" pos="{x} {y} 0">
  <inertial pos="0 0 0" mass="0.4" diaginertia="0.0004 0.0004 0.0004"/>
  <joint name="{n}_roll" axis="1 0 0" range="-0.8 0.8"/>
  <body name="{n}_thigh" pos="0 {out} 0">
    <inertial pos="0 0 -0.08" mass="0.6" diaginertia="0.002 0.002 0.0005"/>
    <joint name="{n}_pitch" axis="0 1 0" range="-1 3"/>
    <geom type="capsule" size="0.015" fromto="0 0 -0.03 0 0 -0.15"/>
    <body name="{n}_calf" pos="0 0 -0.2">
      <inertial pos="0 0 -0.1" mass="0.2" diaginertia="0.001 0.001 0.0001"/>
      <joint name="{n}_knee" axis="0 1 0" range="-2.7 -0.4"/>
      <geom type="capsule" size="0.01" fromto="0 0 -0.03 0 0 -0.17"/>
      <geom type="sphere" size="0.02" pos="0 0 -0.2"/>
    </body>
  </body>
</body>"""
NAMES = ("FL", "FR", "RL", "RR")


def mjcf(keyframe="", joint='armature="0.01"', motor='ctrlrange="-20 20"'):
    legs = "".join(
        LEG.format(
            n=name,
            x=0.2 if name[0] == "F" else -0.2,
            y=0.05 if name[1] == "L" else -0.05,
            out=0.08 if name[1] == "L" else -0.08,
        )
        for name in NAMES
    )
    motors = "".join(
        f'<motor joint="{name}_{part}" {motor}/>'
        for name in NAMES
        for part in ("roll", "pitch", "knee")
    )
    return f"""
<mujoco><compiler angle="radian" autolimits="true"/>
<default><joint {joint}/></default>
<worldbody><geom type="plane" size="1 1 1"/>
<body name="trunk" pos="0 0 0.5"><freejoint/>
<inertial pos="0 0 0" mass="6" diaginertia="0.02 0.06 0.07"/>
<geom type="box" size="0.18 0.04 0.05"/>{legs}</body></worldbody>
<actuator>{motors}</actuator>{keyframe}</mujoco>"""


@pytest.fixture
def made(tmp_path):
    """Import a text; gives what was imported and the robot."""

    def make(text, **options):
        file = tmp_path / "published.xml"
        file.write_text(text)
        imported = import_robot(file, "rover", tmp_path / "robots", **options)
        return imported, load_robot(imported.folder)

    return make


def test_a_published_quadruped_passes_the_check(made):
    imported, robot = made(mjcf())
    assert check_robot(robot, poses=3).failures() == ()
    assert robot.feet == tuple(f"{name}_calf_foot" for name in NAMES)
    assert robot.knee_frames == tuple(f"{name}_calf" for name in NAMES)
    assert robot.abduction_joints == tuple(f"{name}_roll" for name in NAMES)
    assert robot.end_effector.body == "FR_calf_foot"
    assert robot.fall_bodies == ("trunk",)
    assert robot.keypoints["LeftFoot"] == "RL_calf_foot"
    assert robot.total_mass() == pytest.approx(10.8)
    assert list(robot.effort_limits()) == [20.0] * 12
    assert robot.training_effort_limits == (30.0,) * 12
    # 0.85 of a leg of 0.4 m, and the radius of the foot
    assert robot.default_height() == pytest.approx(0.85 * 0.4 + 0.02, abs=1e-3)
    assert {q.key for q in imported.questions} == {
        "robot.toml: joints: speed",
        "robot.toml: joints: default",
    }
    text = (imported.folder / "robot.toml").read_text()
    assert text.count(" } # default, speed: ASK\n") == 12, "what is asked for is found in the file"


def test_legs_are_as_stiff_as_standing_firmly_takes(made):
    imported, robot = made(mjcf().replace('mass="6"', 'mass="36"'))
    assert min(robot.stiffness) > 20.0  # all of the torque at a radian
    stance = stand(robot)
    assert (stance.seconds, stance.fell) == (pytest.approx(10.0, abs=0.05), "")
    assert 0.0 < stance.sag <= 0.05
    assert stance.said in imported.notes


def test_an_action_of_one_asks_legs_for_twice_their_torque_and_clips_for_the_same_angles(made):
    _, robot = made(mjcf().replace('mass="6"', 'mass="36"'))
    asked = robot.action_scale * np.asarray(robot.stiffness) / robot.effort_limits()
    assert np.median(asked) == pytest.approx(2.0, rel=0.01)
    assert robot.walk_action_scale == pytest.approx(robot.action_scale / 3.0, rel=0.01)
    assert robot.inverse_dynamics.largest_action * robot.action_scale == pytest.approx(
        1.5, rel=0.01
    )


def test_a_flat_mesh_that_collides_becomes_a_thin_box(made, tmp_path):
    corners = [(-0.1, -0.05), (0.1, -0.05), (0.1, 0.05), (-0.1, 0.05)]
    obj = [*(f"v {x} {y} 0" for x, y in corners), "f 1 2 3", "f 1 3 4"]
    (tmp_path / "plate.obj").write_text("\n".join(obj))
    text = mjcf().replace(
        '<geom type="box"', '<geom type="mesh" mesh="plate" pos="0 0 0.08"/><geom type="box"'
    )
    asset = '<asset><mesh name="plate" file="plate.obj" inertia="shell"/></asset><worldbody>'
    imported, robot = made(text.replace("<worldbody>", asset))
    assert "plate (box)" in " ".join(imported.notes)
    model = robot.model()
    (plate,) = [g for g in range(model.ngeom) if model.geom(g).name == "trunk_0"]
    assert sorted(model.geom_size[plate]) == pytest.approx([0.0005, 0.05, 0.1], abs=1e-6)
    assert model.geom_pos[plate] == pytest.approx([0.0, 0.0, 0.08], abs=1e-6)
    assert check_robot(robot, poses=3).failures() == ()


def test_a_mesh_as_wide_as_long_becomes_a_primitive():
    """A capsule that is fitted to an octahedron has no length."""
    corners = np.concatenate([np.eye(3), -np.eye(3)])
    spec = mujoco.MjSpec()
    spec.compiler.fitaabb = True
    spec.add_mesh(name="round", uservert=corners.ravel())
    assert best_primitive(spec, "round") == "SPHERE"


def test_the_pose_of_a_keyframe_is_taken(made):
    pose = "0 0.9 -1.8 " * 4
    key = f'<keyframe><key name="home" qpos="0 0 0.3 1 0 0 0 {pose}"/></keyframe>'
    imported, robot = made(mjcf(key))
    np.testing.assert_allclose(robot.default_joint_pos, [0.0, 0.9, -1.8] * 4)
    assert [q.key for q in imported.questions] == ["robot.toml: joints: speed"]
    assert (imported.folder / "robot.toml").read_text().count(" } # speed: ASK\n") == 12
    assert check_robot(robot, poses=3).failures() == ()


HUMAN_LEG = """
<body name="{n}_thigh" pos="0 {y} 0">
  <inertial pos="0 0 -0.2" mass="3" diaginertia="0.03 0.03 0.005"/>
  <joint name="{n}_roll" axis="1 0 0" range="-0.5 0.5"/>
  <body name="{n}_upper" pos="0 0 0">
    <inertial pos="0 0 -0.2" mass="1" diaginertia="0.01 0.01 0.005"/>
    <joint name="{n}_hip" axis="0 1 0" range="-2 2"/>
    <geom type="capsule" size="0.05" fromto="0 0 -0.1 0 0 -0.3"/>
    <body name="{n}_shank" pos="0 0 -0.4">
      <inertial pos="0 0 -0.2" mass="2" diaginertia="0.03 0.03 0.003"/>
      <joint name="{n}_knee" axis="0 1 0" range="0 2.2"/>
      <geom type="capsule" size="0.04" fromto="0 0 -0.05 0 0 -0.3"/>
      <body name="{n}_cross" pos="0 0 -0.4">
        <inertial pos="0 0 0" mass="0.2" diaginertia="0.001 0.001 0.001"/>
        <joint name="{n}_ankle" axis="0 1 0" range="-1 1"/>
        <body name="{n}_sole" pos="0 0 0">
          <inertial pos="0.03 0 -0.03" mass="0.5" diaginertia="0.001 0.002 0.002"/>
          <joint name="{n}_ankle_roll" axis="1 0 0" range="-0.5 0.5"/>
          <geom type="box" size="0.11 0.04 0.015" pos="0.03 0 -0.045"/>
        </body>
      </body>
    </body>
  </body>
</body>"""
ARM = """
<body name="{n}_arm" pos="0 {y} 0.35">
  <inertial pos="0.1 0 -0.2" mass="1.5" diaginertia="0.01 0.01 0.002"/>
  <joint name="{n}_shoulder" axis="0 1 0" range="-2 2"/>
  <geom type="capsule" size="0.03" fromto="0 0 -0.05 0 0 -0.2"/>
  <body name="{n}_forearm" pos="0 0 -0.25">
    <inertial pos="0.1 0 0" mass="0.8" diaginertia="0.002 0.005 0.005"/>
    <joint name="{n}_elbow" axis="0 1 0" range="-2 1"/>
    <body name="{n}_hand" pos="0.2 0 0">
      <inertial pos="0.05 0 0" mass="0.4" diaginertia="0.001 0.001 0.001"/>
      <joint name="{n}_wrist" axis="1 0 0" range="-1 1"/>
      <geom type="sphere" size="0.04" pos="0.05 0 0"/>
    </body>
  </body>
</body>"""


def humanoid():
    """A pelvis on two legs of six hinges, a torso on a waist, and two arms."""
    sides = {"left": 1.0, "right": -1.0}
    legs = "".join(HUMAN_LEG.format(n=name, y=0.1 * side) for name, side in sides.items())
    arms = "".join(ARM.format(n=name, y=0.2 * side) for name, side in sides.items())
    torso = f"""
<body name="torso" pos="0 0 0.1"><joint name="waist" axis="0 1 0" range="-0.5 0.5"/>
<inertial pos="0.02 0 0.25" mass="12" diaginertia="0.3 0.3 0.1"/>
<geom type="box" size="0.08 0.1 0.2" pos="0 0 0.25"/>{arms}</body>"""
    joints = ("roll", "hip", "knee", "ankle", "ankle_roll", "shoulder", "elbow", "wrist")
    motors = "".join(
        f'<motor joint="{name}_{joint}" ctrlrange="-60 60"/>' for name in sides for joint in joints
    )
    return f"""
<mujoco><compiler angle="radian" autolimits="true"/><default><joint armature="0.02"/></default>
<worldbody><body name="pelvis" pos="0 0 1"><freejoint/>
<inertial pos="0 0 0" mass="5" diaginertia="0.05 0.05 0.05"/>
<geom type="box" size="0.07 0.04 0.05"/>{legs}{torso}</body></worldbody>
<actuator>{motors}<motor joint="waist" ctrlrange="-60 60"/></actuator></mujoco>"""


def test_a_keyframe_that_lies_is_not_taken(made):
    lying = " ".join(["0 1.3 -2.6"] * 4)
    key = f'<keyframe><key name="home" qpos="0 0 0.1 1 0 0 0 {lying}"/></keyframe>'
    imported, robot = made(mjcf(key))
    assert robot.default_height() == pytest.approx(0.36, abs=1e-3)
    assert "robot.toml: joints: default" in {question.key for question in imported.questions}


def test_a_rod_that_ends_in_a_foot_is_no_part_of_it(made):
    """Its middle is halfway up the leg: feet were put on the floor by that."""
    rod = 'size="0.01" fromto="0 0 -0.03 0 0 -0.'
    _, robot = made(mjcf().replace(f'{rod}17"', f'{rod}205"'))
    model = robot.model()
    (foot,) = [
        g for g in range(model.ngeom) if model.geom_bodyid[g] == model.body(robot.feet[0]).id
    ]
    assert model.geom_size[foot, 0] == 0.02
    assert robot.default_height() == pytest.approx(0.36, abs=1e-3)


def test_a_humanoid_stands_over_its_feet_and_passes_the_check(made):
    imported, robot = made(humanoid())
    assert check_robot(robot, poses=3).failures() == ()
    assert robot.feet == ("left_sole", "right_sole")
    assert robot.knee_frames == ("left_shank", "right_shank")
    assert robot.end_effector.body == "right_hand"
    assert robot.abduction_joints == ("left_roll", "right_roll")
    assert robot.gait is not None
    stance = stand(robot)
    assert (stance.fell, stance.tilt < 0.2) == ("", True)
    data = mujoco.MjData(robot.model())
    data.qpos[:] = robot.default_qpos()
    mujoco.mj_forward(robot.model(), data)
    soles = [data.body(foot).xpos[0] + 0.03 for foot in robot.feet]
    assert data.subtree_com[1, 0] == pytest.approx(np.mean(soles), abs=2e-3)
    # twice the weight of torso and arms times the height of their centre over the waist
    torso = robot.model().body("torso").id
    weight = robot.model().body_subtreemass[torso] * 9.81
    height = data.subtree_com[torso, 2] - data.body("torso").xpos[2]
    waist = robot.stiffness[robot.joint_names.index("waist")]
    assert waist > 0.99 * max(60.0, 2.0 * weight * height)


def test_the_tasks_of_an_imported_humanoid_can_be_played(made):
    _, robot = made(humanoid())
    check_tasks(robot)
    robot = replace(robot, tasks={name: robot.tasks[name] for name in ("walk", "reach_in_place")})
    assert [check.problem for check in trial_checks(robot) if not check.passed] == []


def test_what_a_file_does_not_say_is_asked_for_and_found_by_the_check(made):
    imported, robot = made(mjcf(joint="", motor=""))
    keys = [question.key for question in imported.questions]
    assert keys[0] == "rover.xml: joint: actuatorfrcrange"
    assert "rover.xml: joint: armature" in keys
    (problem,) = [check.problem for check in check_robot(robot, poses=3).failures()]
    assert "rover.xml: joints: actuatorfrcrange of joint 'FL_roll': expected a number" in problem


def test_a_torque_that_no_motor_has_is_asked_for(made):
    said, wild = 'joint="FL_knee" ctrlrange="-20 20"', 'joint="FL_knee" ctrlrange="-1000 1000"'
    imported, robot = made(mjcf().replace(said, wild))
    knee = robot.joint_names.index("FL_knee")
    assert [effort == 20.0 for effort in robot.effort_limits()] == [j != knee for j in range(12)]
    note = "torque limits that no such motor has were left out: FL_knee (1000 N.m)"
    assert note in imported.notes
    asked = {question.key: question.what for question in imported.questions}
    assert asked["rover.xml: joint: actuatorfrcrange"] == "torque limit, N.m, of FL_knee"


def test_bodies_may_have_the_names_of_joints(made):
    _, robot = made(mjcf().replace("_hip", "_roll").replace("_calf", "_knee"))
    assert robot.knee_frames == tuple(f"{name}_knee" for name in NAMES)
    assert check_robot(robot, poses=3).failures() == ()
    robot = replace(robot, tasks={"reach_in_place": robot.tasks["reach_in_place"]})
    assert [check.problem for check in trial_checks(robot) if not check.passed] == []


def test_joints_can_be_welded(made):
    _, robot = made(mjcf(), fixed=["*_roll"])
    assert robot.num_joints == 8 and robot.abduction_joints == ()
    assert check_robot(robot, poses=3).failures() == ()


@pytest.mark.parametrize(
    ("change", "problem"),
    [
        (("<freejoint/>", '<joint type="slide" name="rail"/>'), "moves on joint 'rail'"),
        (('name="FL_roll"', 'name="FL_roll" type="slide"'), "'FL_roll' is a slide"),
        (("<mujoco>", "<mujoco><mujoco"), "cannot be read"),
        (('mass="6"', 'mass="-6"'), "'trunk' weighs -6 kg"),
    ],
)
def test_what_cannot_be_a_robot_is_refused_and_leaves_nothing(made, tmp_path, change, problem):
    with pytest.raises(RobotError, match=problem) as caught:
        made(mjcf().replace(*change))
    assert "\n" not in str(caught.value)
    assert not (tmp_path / "robots").exists()


def test_a_robot_on_its_back_is_refused(made):
    text = mjcf().replace("0 0 -0.2", "0 0 0.2")
    for narrow in ('"-1 3"', '"-2.7 -0.4"'):  # too narrow to turn the legs down
        text = text.replace(f"range={narrow}", 'range="-0.1 0.1"')
    with pytest.raises(RobotError, match="feet are above its base"):
        made(text)


def test_a_robot_that_is_there_is_kept(made, tmp_path):
    (tmp_path / "robots" / "rover").mkdir(parents=True)
    with pytest.raises(RobotError, match="is there already"):
        made(mjcf())


def test_meshes_are_found_from_wherever_the_file_is_named(tmp_path, monkeypatch):
    """MuJoCo names them from the working directory, or from the folder of the file."""
    (tmp_path / "published" / "assets").mkdir(parents=True)
    corners = ["v 0 0 0", "v 0.1 0 0", "v 0 0.1 0", "v 0 0 0.1"]
    obj = "\n".join([*corners, "f 1 3 2", "f 1 2 4", "f 2 3 4", "f 3 1 4"])
    (tmp_path / "published" / "assets" / "wedge.obj").write_text(obj)
    asset = '<asset><mesh name="wedge" file="assets/wedge.obj"/></asset><worldbody>'
    seen = '<geom type="mesh" mesh="wedge" contype="0" conaffinity="0"/><geom type="box"'
    text = mjcf().replace("<worldbody>", asset).replace('<geom type="box"', seen)
    (tmp_path / "published" / "rover.xml").write_text(text)
    monkeypatch.chdir(tmp_path)
    imported = import_robot(Path("published/rover.xml"), "rover", Path("robots"))
    assert (imported.folder / "meshes" / "wedge.obj").read_text() == obj


@pytest.mark.parametrize(
    ("name", "to", "problem"),
    [
        ("rover", "published.xml", "--to published.xml: cannot be made"),
        ("go2", "robots", "--name go2: is another robot"),
    ],
)
def test_a_place_and_a_name_that_cannot_be_taken(tmp_path, monkeypatch, name, to, problem):
    (tmp_path / "published.xml").write_text(mjcf())
    monkeypatch.chdir(tmp_path)
    with pytest.raises(RobotError, match=problem):
        import_robot(Path("published.xml"), name, Path(to))
    assert [path.name for path in tmp_path.iterdir()] == ["published.xml"]
