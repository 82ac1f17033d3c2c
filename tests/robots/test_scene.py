from dataclasses import replace

import mujoco
import numpy as np
import pytest
from mujoco.batch import Batch

from lacoloco.robots.errors import RobotError
from lacoloco.robots.scene import compile_scene

# front knees back, hind knees forward: unlike the default pose, Solo12 stands in it on kp 4
MIRROR = np.array([0, 0.8, -1.6] * 2 + [0, -0.8, 1.6] * 2)


def force(data, body):
    return data.sensor(f"force_{body}").data


def settle(model, qpos, ctrl, steps):
    data = mujoco.MjData(model)
    data.qpos[:] = qpos
    data.ctrl[:] = ctrl
    mujoco.mj_step(model, data, steps)
    return data


@pytest.fixture
def standing(solo12):
    qpos = np.concatenate([[0, 0, 0.25, 1, 0, 0, 0], MIRROR])
    return settle(compile_scene(solo12), qpos, MIRROR, 600)


def test_foot_forces_of_a_standing_robot_carry_its_weight(solo12, standing):
    total = sum(force(standing, foot) for foot in solo12.feet)
    np.testing.assert_allclose(np.abs(total), [0, 0, solo12.weight()], atol=0.01)
    for body in solo12.contact_bodies[4:]:
        assert not force(standing, body).any(), body


def test_lying_on_the_back_is_felt_by_the_fall_body_alone(solo12):
    qpos = solo12.default_qpos()
    qpos[3:7] = [0, 1, 0, 0]
    qpos[2] = 0.05
    data = settle(compile_scene(solo12), qpos, solo12.default_joint_pos, 400)
    assert np.linalg.norm(force(data, "base_link")) == pytest.approx(solo12.weight(), rel=0.01)
    assert not any(force(data, foot).any() for foot in solo12.feet)


def test_lying_forward_is_felt_by_the_torso_of_h1(h1):
    qpos = h1.default_qpos()
    qpos[3:7] = [0.5**0.5, 0, 0.5**0.5, 0]  # face down
    qpos[2] = 0.15
    data = settle(compile_scene(h1), qpos, h1.default_joint_pos, 300)
    assert np.linalg.norm(force(data, "torso_link")) > 1.0


def test_friction_of_the_feet_counts_whatever_the_floor_has(solo12):
    model = compile_scene(solo12)
    batch = Batch(model, nsim=2, nthread=1)
    feet = [model.geom(foot).id for foot in solo12.feet]
    batch.expand("geom_friction")[:, feet, 0] = [[0.1], [1.2]]
    qpos, qvel, ctrl = batch.bind("qpos"), batch.bind("qvel"), batch.bind("ctrl")
    qpos[:] = np.concatenate([[0, 0, 0.21, 1, 0, 0, 0], MIRROR])
    ctrl[:] = MIRROR
    batch.step(nstep=200)
    start = qpos[:, 0].copy()
    qvel[:, 0] = 0.6  # m/s; a block would slide v^2 / (2 mu g) = 18 cm and 1.5 cm
    batch.step(nstep=200)
    slippery, rough = qpos[:, 0] - start
    assert slippery > 0.1
    assert rough < 0.05


def test_legs_of_solo12_collide_and_those_of_h1_do_not(solo12, h1):
    crossed = {
        "solo12": {"FL_HAA": -0.6, "FR_HAA": 0.6},
        "h1": {"left_hip_roll": -0.43, "right_hip_roll": 0.43},
    }
    for robot, expected in ((solo12, True), (h1, False)):
        model = compile_scene(robot)
        data = mujoco.MjData(model)
        data.qpos[:] = robot.default_qpos()
        data.qpos[2] = 5.0
        for joint, angle in crossed[robot.name].items():
            data.joint(joint).qpos = angle
        mujoco.mj_forward(model, data)
        assert (data.ncon > 0) is expected, robot.name


def test_solo12_does_not_touch_itself_around_its_usual_poses(solo12):
    model = compile_scene(solo12, floor=False)
    data = mujoco.MjData(model)
    rng = np.random.default_rng(0)
    for centre in (solo12.default_joint_pos, solo12.retarget_neutral, MIRROR):
        for _ in range(100):
            data.qpos[7:] = centre + rng.uniform(-0.25, 0.25, 12)
            mujoco.mj_forward(model, data)
            assert data.ncon == 0


@pytest.mark.parametrize("training", [False, True])
def test_motors_follow_the_law_up_to_their_limit(robot, training):
    model = compile_scene(robot, floor=False, training_limits=training)
    data = mujoco.MjData(model)
    rng = np.random.default_rng(1)
    q0 = np.array(robot.default_joint_pos)
    limit = np.array(robot.training_effort_limits) if training else robot.effort_limits()
    wanted = rng.uniform(-1.5, 1.5, robot.num_joints) * limit
    data.qpos[:] = robot.default_qpos()
    data.qvel[6:] = rng.normal(size=robot.num_joints)
    data.ctrl[:] = q0 + (wanted + robot.damping * data.qvel[6:]) / robot.stiffness
    mujoco.mj_forward(model, data)
    expected = np.clip(wanted, -limit, limit)
    assert (expected != wanted).any() and (expected == wanted).any()
    np.testing.assert_allclose(data.qfrc_actuator[6:], expected, atol=1e-9)


def test_motors_sensors_and_keyframe_are_in_the_order_of_the_spec(robot):
    model = compile_scene(robot)
    assert [model.actuator(i).name for i in range(model.nu)] == list(robot.joint_names)
    sensors = [model.sensor(i).name for i in range(model.nsensor)]
    assert sensors == [f"force_{body}" for body in robot.contact_bodies]
    assert model.nsensordata == 3 * len(sensors)
    np.testing.assert_allclose(model.key("default").qpos, robot.default_qpos(), atol=1e-9)
    np.testing.assert_array_equal(model.key("default").ctrl, robot.default_joint_pos)


def test_what_is_only_looked_at_changes_no_motion(robot):
    plain, drawn = compile_scene(robot), compile_scene(robot, visual=True)
    assert drawn.ngeom > plain.ngeom
    assert plain.body_mass.sum() == pytest.approx(drawn.body_mass.sum(), abs=0)
    ends = [settle(m, robot.default_qpos(), robot.default_joint_pos, 50) for m in (plain, drawn)]
    np.testing.assert_array_equal(ends[0].qpos, ends[1].qpos)


def test_options_of_compile_scene(solo12):
    model = compile_scene(solo12, floor=False, timestep=0.002)
    assert model.opt.timestep == 0.002
    assert "floor" not in [model.geom(i).name for i in range(model.ngeom)]
    assert compile_scene(solo12) is not compile_scene(solo12)


def test_names_the_mjcf_lacks_are_named(solo12):
    with pytest.raises(RobotError, match="XX_HAA"):
        compile_scene(replace(solo12, joint_names=("XX_HAA", *solo12.joint_names[1:])))
    with pytest.raises(RobotError, match="tail"):
        compile_scene(replace(solo12, fall_bodies=("tail",)))
