"""The contract of `Physics`, on the CPU engine."""

import math
from pathlib import Path

import mujoco
import numpy as np
import pytest
import torch

from lacoloco.pipelines.errors import StageError
from lacoloco.pipelines.sim.engines import make_physics
from lacoloco.pipelines.sim.physics import (
    CONTROL_DT,
    SUBSTEPS,
    PhysicsRequest,
    WorldParameters,
    monitored_bodies,
)
from lacoloco.robots.scene import compile_scene

# Front knees back, hind knees forward: a pose in which Solo12 stands on its weak motors.
STANDING = torch.tensor([0, 0.8, -1.6] * 2 + [0, -0.8, 1.6] * 2)
TOUCHING = 2 * 0.16 * math.cos(0.8) + 0.02  # m: two leg segments and the radius of the foot


@pytest.fixture
def make_standing(solo12):
    """Factory of N worlds in which Solo12 has stood for two seconds."""

    def factory(worlds, settle=100, parameters=None, **options):
        physics = make_physics(PhysicsRequest(solo12, worlds, threads=1, **options))
        if parameters is not None:
            physics.set_parameters(parameters)
        physics.reset(torch.arange(worlds), standing_qpos(worlds), torch.zeros(worlds, 18))
        hold(physics, settle)
        return physics

    return factory


def standing_qpos(worlds):
    qpos = torch.zeros(worlds, 19)
    qpos[:, 2], qpos[:, 3], qpos[:, 7:] = TOUCHING, 1.0, STANDING
    return qpos


def hold(physics, steps, targets=STANDING):
    for _ in range(steps):
        physics.step(targets.repeat(physics.num_worlds, 1))


def parameters(worlds, **changes):
    values = {
        "friction": torch.ones(worlds),
        "foot_friction": torch.ones(worlds, 4),
        "contact_time": torch.ones(worlds),
        "contact_damping": torch.ones(worlds),
        "mass_scale": torch.ones(worlds),
        "inertia_scale": torch.ones(worlds),
        "base_com_offset": torch.zeros(worlds, 3),
    }
    return WorldParameters(**{**values, **changes})


def test_feet_of_a_standing_robot_carry_its_weight_in_every_substep(make_standing, solo12):
    physics = make_standing(3)
    total = physics.foot_force.sum(dim=-1)
    assert physics.foot_force.shape == (3, SUBSTEPS, 4)
    # Norms: feet that stand firm also press against each other, by friction.
    assert torch.allclose(total, torch.full_like(total, solo12.weight()), rtol=3e-2)
    assert float(total.min()) > 0.999 * solo12.weight()
    assert not physics.body_force.any()


def test_shapes_and_kinds_are_those_of_the_contract(robot):
    joints = robot.num_joints
    physics = make_physics(PhysicsRequest(robot, 2, threads=1))
    physics.step(torch.tensor(robot.default_joint_pos).repeat(2, 1))
    assert physics.qpos.shape == (2, 7 + joints)
    assert physics.qvel.shape == (2, 6 + joints)
    assert physics.torque.shape == (2, joints)
    assert physics.foot_force.shape == (2, SUBSTEPS, len(robot.feet))
    assert physics.body_force.shape == (2, len(physics.monitored))
    assert physics.monitored == monitored_bodies(robot)
    assert physics.monitored[: len(robot.fall_bodies)] == robot.fall_bodies
    for tensor in (physics.qpos, physics.qvel, physics.torque, physics.foot_force):
        assert tensor.dtype == torch.float32
    assert physics.diverged.dtype == torch.bool


def test_a_landing_shows_in_the_substep_in_which_it_happens(make_standing):
    """A fall of 3 mm takes sqrt(2 h / g) = 25 ms, so contact begins in the eighth substep of 10 / 3
    ms.
    """
    physics = make_standing(1, settle=1)
    qpos = standing_qpos(1)
    qpos[:, 2] += 0.003
    physics.reset(torch.tensor([0]), qpos, torch.zeros(1, 18))
    forces = []
    for _ in range(2):
        hold(physics, 1)
        forces.append(physics.foot_force[0].sum(dim=-1))
    forces = torch.cat(forces)
    assert int(torch.nonzero(forces > 0)[0]) == 7


def test_forces_are_those_of_plain_mujoco_in_every_substep(solo12):
    """A robot that lands on its back: a base hits the ground, feet do not."""
    physics = make_physics(PhysicsRequest(solo12, 2, threads=1))
    qpos, qvel = standing_qpos(1), torch.zeros(1, 18)
    qpos[:, 2], qpos[:, 3:7], qvel[:, 2] = 0.03, torch.tensor([0.0, 1.0, 0.0, 0.0]), -2.0
    physics.reset(torch.tensor([1]), qpos, qvel)
    hold(physics, 1)
    data = mujoco.MjData(compile_scene(solo12, training_limits=True))
    data.qpos[:], data.qvel[:], data.ctrl[:] = qpos[0], qvel[0], STANDING
    norms = {name: [] for name in (*solo12.feet, *physics.monitored)}
    for _ in range(SUBSTEPS):
        mujoco.mj_step(data.model, data)
        for name, seen in norms.items():
            seen.append(np.linalg.norm(data.sensor(f"force_{name}").data))
    feet = np.stack([norms[name] for name in solo12.feet], axis=1)
    np.testing.assert_allclose(physics.foot_force[1], feet, rtol=1e-5, atol=1e-5)
    bodies = [max(norms[name]) for name in physics.monitored]
    np.testing.assert_allclose(physics.body_force[1], bodies, rtol=1e-5, atol=1e-5)
    assert np.count_nonzero(norms["base_link"]) > 1
    np.testing.assert_allclose(physics.qpos[1], data.qpos, atol=1e-6)


def test_torque_is_that_of_the_position_motors(solo12):
    """tau = kp (target - q) - kd qd: an airborne robot whose joints rest 0.1 rad off target."""
    physics = make_physics(PhysicsRequest(solo12, 1, threads=1))
    qpos = standing_qpos(1)
    qpos[:, 2] = 2.0
    physics.reset(torch.tensor([0]), qpos, torch.zeros(1, 18))
    data = mujoco.MjData(compile_scene(solo12, training_limits=True))
    data.qpos[:] = qpos[0].numpy()
    data.ctrl[:] = (STANDING + 0.1).numpy()
    mujoco.mj_step(data.model, data, SUBSTEPS - 1)
    expected = 4.0 * (data.ctrl - data.qpos[7:]) - 0.2 * data.qvel[6:]
    hold(physics, 1, STANDING + 0.1)
    np.testing.assert_allclose(physics.torque[0], expected, atol=1e-5)


def test_motors_are_as_strong_as_asked_for(solo12):
    far = STANDING + 3.0  # rad; kp 4 would ask for 12 N.m
    for training, limit in ((True, 4.5), (False, 3.0)):
        physics = make_physics(PhysicsRequest(solo12, 1, training_limits=training, threads=1))
        physics.reset(torch.tensor([0]), standing_qpos(1), torch.zeros(1, 18))
        hold(physics, 1, far)
        assert float(physics.torque.abs().max()) == pytest.approx(limit, rel=1e-6)


def test_reset_touches_only_its_worlds(make_standing):
    physics, untouched = make_standing(4), make_standing(4)
    qpos = standing_qpos(2)
    qpos[:, 0] = torch.tensor([5.0, 6.0])
    qvel = torch.full((2, 18), 0.25)
    physics.reset(torch.tensor([1, 3]), qpos, qvel)
    assert torch.equal(physics.qpos[[1, 3]], qpos)
    assert torch.equal(physics.qvel[[1, 3]], qvel)
    hold(physics, 5)
    hold(untouched, 5)
    assert torch.equal(physics.qpos[[0, 2]], untouched.qpos[[0, 2]])
    assert torch.equal(physics.foot_force[[0, 2]], untouched.foot_force[[0, 2]])
    assert not torch.allclose(physics.qpos[[1, 3]], untouched.qpos[[1, 3]], atol=0.1)


def test_reset_of_no_world_changes_nothing(make_standing):
    physics = make_standing(2)
    before = physics.state_dict()["rows"]
    physics.reset(torch.zeros(0, dtype=torch.long), torch.zeros(0, 19), torch.zeros(0, 18))
    assert torch.equal(physics.state_dict()["rows"], before)


def test_a_reset_world_forgets_all_of_its_past(make_standing):
    """Also the warm start of the contact solver: equal worlds give equal futures, bit for bit."""
    physics = make_standing(2)
    physics.reset(torch.tensor([0]), standing_qpos(1), torch.zeros(1, 18))
    hold(physics, 7)
    physics.reset(torch.arange(2), standing_qpos(2), torch.zeros(2, 18))
    hold(physics, 7)
    assert torch.equal(physics.qpos[0], physics.qpos[1])


@pytest.mark.parametrize("column", ["position", "velocity", "joint"])
def test_a_diverged_world_is_noticed_and_never_spreads(
    make_standing, in_a_temporary_folder, column
):
    physics, healthy = make_standing(3), make_standing(3)
    for _ in range(2):  # twice: MuJoCo's counters of warnings do not rise the second time
        qpos, qvel = standing_qpos(1), torch.zeros(1, 18)
        if column == "position":
            qpos[0, 2] = torch.nan
        elif column == "joint":
            qpos[0, 9] = torch.inf
        else:
            qvel[0, 8] = 1e12
        physics.reset(torch.tensor([1]), qpos, qvel)
        hold(physics, 1)
        hold(healthy, 1)
        assert physics.diverged.tolist() == [False, True, False]
        for tensor in (physics.qpos, physics.qvel, physics.foot_force, physics.torque):
            assert torch.isfinite(tensor).all()
    hold(physics, 20)
    hold(healthy, 20)
    assert not physics.diverged.any()
    assert torch.equal(physics.qpos[[0, 2]], healthy.qpos[[0, 2]])
    assert not Path("MUJOCO_LOG.TXT").exists()


def test_a_world_that_diverges_twice_without_a_reset_is_noticed_twice(
    make_standing, in_a_temporary_folder
):
    physics = make_standing(2)
    kick = torch.zeros(1, 6)
    kick[0, 5] = 1e11
    for _ in range(2):
        physics.push(torch.tensor([0]), kick)
        hold(physics, 1)
        assert physics.diverged.tolist() == [True, False]
        hold(physics, 1)
        assert not physics.diverged.any()


def test_a_target_that_is_no_number_counts_as_divergence(make_standing, in_a_temporary_folder):
    physics = make_standing(2)
    targets = STANDING.repeat(2, 1)
    targets[1, 4] = torch.nan
    physics.step(targets)
    assert physics.diverged.tolist() == [False, True]
    assert torch.isfinite(physics.qpos).all()


def test_push_adds_to_the_velocity_and_leaves_the_rest(make_standing):
    physics = make_standing(3)
    qpos, qvel = physics.qpos, physics.qvel
    kick = torch.tensor([[0.1, -0.2, 0.3, 0.4, 0.5, -0.6]])
    physics.push(torch.tensor([2]), kick)
    assert torch.allclose(physics.qvel[2, :6], qvel[2, :6] + kick[0], atol=1e-6)
    assert torch.equal(physics.qvel[:2], qvel[:2])
    assert torch.equal(physics.qpos, qpos)


def test_old_tensors_stay_as_they_were(make_standing):
    """A step makes new tensors, so that the state before it may be kept without a copy."""
    physics = make_standing(1)
    qpos, force = physics.qpos, physics.foot_force
    copies = qpos.clone(), force.clone()
    hold(physics, 3, STANDING + 0.3)
    assert torch.equal(qpos, copies[0])
    assert torch.equal(force, copies[1])
    assert not torch.equal(physics.qpos, qpos)


def test_a_heavier_world_stands_heavier(make_standing, solo12):
    scale = torch.tensor([0.8, 1.0, 1.2])
    physics = make_standing(3, parameters=parameters(3, mass_scale=scale))
    expected = scale * solo12.weight()
    assert torch.allclose(physics.foot_force[:, -1].sum(-1), expected, rtol=3e-2)


def test_a_softer_contact_hits_less_and_a_less_damped_one_more(make_standing):
    """Stiffness is mass / (time constant x damping ratio)^2."""
    changes = {
        "contact_time": torch.tensor([1.0, 1.5, 1.0]),
        "contact_damping": torch.tensor([1.0, 1.0, 0.7]),
    }
    physics = make_standing(3, settle=1, parameters=parameters(3, **changes))
    qpos = standing_qpos(3)
    qpos[:, 2] += 0.05
    physics.reset(torch.arange(3), qpos, torch.zeros(3, 18))
    peaks = torch.zeros(3)
    for _ in range(10):
        hold(physics, 1)
        peaks = peaks.maximum(physics.foot_force.amax(dim=(1, 2)))
    usual, softer, less_damped = peaks.tolist()
    assert softer < 0.8 * usual
    assert less_damped > 1.02 * usual


def test_each_foot_has_its_own_friction(make_standing):
    """The friction of a foot is its world's times its own factor."""
    own = torch.tensor([[1.0, 1.0, 1.0, 1.0], [0.05, 1.0, 1.0, 1.0]])
    physics = make_standing(2, parameters=parameters(2, foot_friction=own))
    model = physics.model
    friction = physics._batch.expand("geom_friction")[:, :, 0]
    foot = [g for g in range(model.ngeom) if model.geom_bodyid[g] == model.body("FL_FOOT").id]
    other = [g for g in range(model.ngeom) if model.geom_bodyid[g] == model.body("HR_FOOT").id]
    assert friction[:, foot].ravel().tolist() == pytest.approx([1.0, 0.05])
    assert friction[:, other].ravel().tolist() == pytest.approx([1.0, 1.0])


def test_a_slippery_world_slides_further(make_standing):
    """Friction mu stops a sliding block after v^2 / (2 mu g)."""
    friction = torch.tensor([0.1, 1.2])
    physics = make_standing(2, parameters=parameters(2, friction=friction))
    start = physics.qpos[:, 0]
    push = torch.zeros(2, 6)
    push[:, 0] = 0.6
    physics.push(torch.arange(2), push)
    hold(physics, 50)
    slippery, rough = (physics.qpos[:, 0] - start).tolist()
    assert slippery > 0.1  # a block: 18 cm
    assert rough < 0.05  # a block: 1.5 cm


def test_inertia_slows_the_joints(make_standing):
    """In the air, a shank follows a step of its target the later, the larger its inertia."""
    scale = torch.tensor([0.8, 1.0, 1.2])
    physics = make_standing(3, settle=1, parameters=parameters(3, inertia_scale=scale))
    qpos = standing_qpos(3)
    qpos[:, 2] = 2.0
    physics.reset(torch.arange(3), qpos, torch.zeros(3, 18))
    hold(physics, 1, STANDING + torch.tensor([0.0, 0.0, 0.1] * 4))
    knee = physics.qpos[:, 9] - STANDING[2]
    assert knee[0] > knee[1] > knee[2] > 0
    assert knee[0] - knee[2] > 1e-5


def test_centre_of_mass_shifts_the_load_between_the_feet(make_standing):
    """Moments about the hind feet: a base moved forward loads the front feet more."""
    offset = torch.tensor([[0.02, 0.0, 0.0], [0.0, 0.0, 0.0], [-0.02, 0.0, 0.0]])
    physics = make_standing(3, parameters=parameters(3, base_com_offset=offset))
    front = physics.foot_force[:, -1, :2].sum(-1)
    assert front[0] - front[1] == pytest.approx(float(front[1] - front[2]), rel=0.3)
    assert front[0] > front[1] + 0.2


def test_state_dict_goes_on_bit_for_bit(make_standing):
    physics = make_standing(3)
    hold(physics, 4, STANDING + 0.2)
    state = physics.state_dict()
    other = make_standing(3, settle=3)
    other.load_state_dict(state)
    assert torch.equal(other.qpos, physics.qpos)
    for engine in (physics, other):
        hold(engine, 6, STANDING - 0.2)
    assert torch.equal(other.qpos, physics.qpos)
    assert torch.equal(other.qvel, physics.qvel)
    assert torch.equal(other.foot_force, physics.foot_force)
    # What was saved must not have moved on with the engine.
    assert not torch.equal(state["rows"], physics.state_dict()["rows"])


def test_threads_do_not_change_the_result(solo12):
    results = []
    for threads in (1, 2):
        physics = make_physics(PhysicsRequest(solo12, 8, threads=threads))
        qpos = standing_qpos(8)
        qpos[:, 2] += 0.01 * torch.arange(8)
        physics.reset(torch.arange(8), qpos, torch.zeros(8, 18))
        hold(physics, 20)
        results.append(physics.qpos)
    assert torch.equal(*results)


def test_a_step_lasts_a_fiftieth_of_a_second(solo12):
    """Free fall from rest: after k steps v = -g t."""
    physics = make_physics(PhysicsRequest(solo12, 1, threads=1))
    qpos = standing_qpos(1)
    qpos[:, 2] = 3.0
    physics.reset(torch.tensor([0]), qpos, torch.zeros(1, 18))
    hold(physics, 5)
    assert float(physics.qvel[0, 2]) == pytest.approx(-9.81 * 5 * CONTROL_DT, rel=1e-3)


def test_a_device_without_an_engine_is_refused_by_name(solo12):
    with pytest.raises(StageError, match="--device tpu"):
        make_physics(PhysicsRequest(solo12, 1), "tpu:0")
