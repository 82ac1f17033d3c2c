import casadi as ca
import numpy as np
import pinocchio as pin
import pytest

from lacoloco.pipelines.errors import StageError
from lacoloco.pipelines.retargeting import forward_kinematics as kinematics
from lacoloco.robots.registry import load_robot, robot_names


def random_configurations(model, count, seed=0):
    rng = np.random.default_rng(seed)
    quat = rng.normal(size=(count, 4))
    quat /= np.linalg.norm(quat, axis=1, keepdims=True)
    return rng.normal(size=(count, 3)), quat, rng.uniform(-3, 3, size=(count, model.nq - 7))


@pytest.mark.parametrize("name", robot_names())
def test_every_body_is_where_pinocchio_puts_it(name):
    model = load_robot(name).pinocchio_model()
    data = model.createData()
    bodies = [f.name for f in model.frames if f.type == pin.FrameType.BODY]
    positions, quats, joints = random_configurations(model, 50)

    points = kinematics.BodyPositions(model, bodies)(positions, quats, joints)

    for row, position, quat, joint in zip(points, positions, quats, joints, strict=True):
        pin.framesForwardKinematics(model, data, np.r_[position, quat[1:], quat[0], joint])
        expected = [data.oMf[model.getFrameId(b, pin.FrameType.BODY)].translation for b in bodies]
        np.testing.assert_allclose(row, expected, atol=1e-12)


def test_prismatic_and_tilted_joints_follow_pinocchio(tmp_path):
    path = tmp_path / "robot.xml"
    path.write_text("""<mujoco model="slider"><compiler angle="radian"/><worldbody>
      <body name="base"><freejoint name="root_joint"/><geom size=".1" mass="1"/>
        <body name="arm" pos=".1 .2 .3" quat=".5 .5 .5 .5">
          <joint name="slide" type="slide" axis="0 .6 .8"/><geom size=".1" mass="1"/>
          <body name="hand" pos="0 .3 0">
            <joint name="turn" axis=".6 0 .8"/><geom size=".1" mass="1"/>
            <body name="tip" pos=".1 .1 0"><geom size=".1" mass="1"/></body>
    </body></body></body></worldbody></mujoco>""")
    model = pin.buildModelFromMJCF(str(path))
    data = model.createData()
    positions, quats, joints = random_configurations(model, 20)
    points = kinematics.BodyPositions(model, ["hand", "tip"])(positions, quats, joints)
    for row, position, quat, joint in zip(points, positions, quats, joints, strict=True):
        pin.framesForwardKinematics(model, data, np.r_[position, quat[1:], quat[0], joint])
        for point, body in zip(row, ["hand", "tip"], strict=True):
            frame = model.getFrameId(body, pin.FrameType.BODY)
            np.testing.assert_allclose(point, data.oMf[frame].translation, atol=1e-12)


def test_a_point_beside_the_origin_of_a_body():
    spec = load_robot("h1")
    model = spec.pinocchio_model()
    data = model.createData()
    body, offset = spec.end_effector.body, np.array([0.3, -0.1, 0.2])
    positions, quats, joints = random_configurations(model, 3)
    points = kinematics.BodyPositions(model, [body], [offset])(positions, quats, joints)
    pin.framesForwardKinematics(
        model, data, np.r_[positions[0], quats[0, 1:], quats[0, 0], joints[0]]
    )
    expected = data.oMf[model.getFrameId(body, pin.FrameType.BODY)].act(offset)
    np.testing.assert_allclose(points[0, 0], expected, atol=1e-12)


def test_a_missing_body_is_named():
    model = load_robot("solo12").pinocchio_model()
    with pytest.raises(StageError, match="FL_PAW.*FL_FOOT"):
        kinematics.BodyPositions(model, ["FL_PAW"])


@pytest.mark.parametrize("angle", [0.0, 1e-9, 0.3, 3.0])
def test_small_rotation_turns_by_its_angle(angle):
    axis = np.array([0.36, 0.48, 0.8])
    quat = np.array(ca.DM(kinematics.small_rotation(ca.DM(axis * np.tan(angle / 4))))).ravel()
    np.testing.assert_allclose(quat, [np.cos(angle / 2), *np.sin(angle / 2) * axis], atol=1e-15)


def test_multiply_composes_rotations():
    rng = np.random.default_rng(1)
    first, second = (q / np.linalg.norm(q) for q in rng.normal(size=(2, 4)))
    product = kinematics.rotation_of(kinematics.multiply(ca.SX(first), ca.SX(second)))
    chained = kinematics.rotation_of(ca.SX(first)) @ kinematics.rotation_of(ca.SX(second))
    np.testing.assert_allclose(ca.DM(product), ca.DM(chained), atol=1e-15)
