"""Disturbed physics: without a disturbance nothing changes, and each one does what it says."""

import math
from dataclasses import replace

import numpy as np
import pytest
import torch

from lacoloco.pipelines.errors import StageError
from lacoloco.pipelines.sim.disturbances.config import Disturbances
from lacoloco.pipelines.sim.disturbances.engine import DisturbedBatch
from lacoloco.pipelines.sim.engines import make_physics
from lacoloco.pipelines.sim.mujoco_cpu import BatchPhysics
from lacoloco.pipelines.sim.physics import CONTROL_DT, PhysicsRequest
from lacoloco.pipelines.sim.randomisation import Randomisation, draw_parameters


def built(spec, worlds=3, **fields):
    request = PhysicsRequest(spec, worlds, threads=1, disturbances=Disturbances(**fields))
    physics = DisturbedBatch(request)
    physics.set_parameters(parameters(spec, worlds))
    return standing(physics, spec)


def parameters(spec, worlds):
    generator = torch.Generator().manual_seed(1)
    return draw_parameters(Randomisation(), worlds, len(spec.feet), generator)


def standing(physics, spec):
    qpos = torch.from_numpy(spec.default_qpos()).float().repeat(physics.num_worlds, 1)
    physics.reset(torch.arange(physics.num_worlds), qpos, torch.zeros(len(qpos), qpos.shape[1] - 1))
    return physics


def held(spec, worlds=3):
    return torch.tensor(spec.default_joint_pos).repeat(worlds, 1)


def test_without_a_disturbance_it_is_the_usual_engine_bit_for_bit(solo12):
    usual = BatchPhysics(PhysicsRequest(solo12, 3, threads=1))
    usual.set_parameters(parameters(solo12, 3))
    standing(usual, solo12)
    disturbed = built(solo12)
    generator = torch.Generator().manual_seed(0)
    for _ in range(20):
        targets = held(solo12) + 0.5 * torch.randn(3, 12, generator=generator)
        usual.step(targets)
        disturbed.step(targets)
    for name in ("qpos", "qvel", "foot_force", "body_force", "torque", "diverged"):
        assert torch.equal(getattr(usual, name), getattr(disturbed, name)), name
    assert torch.equal(disturbed.trace[:, -1, : 7 + 12], disturbed.qpos)


def test_the_usual_engine_is_taken_where_nothing_is_disturbed(solo12):
    plain = make_physics(PhysicsRequest(solo12, 1, disturbances=Disturbances(noise=1.0)))
    assert type(plain) is BatchPhysics, "noise is the sensors'"
    late = PhysicsRequest(solo12, 1, disturbances=Disturbances(observation_latency=0.01))
    assert isinstance(make_physics(late), DisturbedBatch)
    with pytest.raises(StageError, match="no other engine beside them"):
        make_physics(replace(late, disturbances=Disturbances(engine="warp", payload=0.1)))


def first_motion(physics, spec):
    """Seconds until a joint of world 0 answers a changed target."""
    speed = []
    for target in (held(spec), held(spec) + 0.3, held(spec) + 0.3):
        physics.step(target)
        speed.append(physics.trace[0, :, -1].abs())
    moving = torch.nonzero(torch.cat(speed[1:]) > 1.0)
    return float(moving[0]) * CONTROL_DT / physics.substeps


def test_a_late_target_arrives_so_much_later(solo12):
    usual = first_motion(built(solo12), solo12)
    assert first_motion(built(solo12, action_latency=0.01), solo12) == pytest.approx(usual + 0.01)
    assert first_motion(built(solo12, action_latency=0.02), solo12) == pytest.approx(usual + 0.02)


def test_jitter_keeps_the_mean_latency(solo12):
    physics = built(solo12, worlds=200, action_latency=0.005, latency_jitter=0.5)
    steps = []
    for _ in range(20):
        clock = physics._motors._clock
        physics.step(held(solo12, 200))
        steps.append(physics._motors._arrival[-1] - clock)
    delays = np.concatenate(steps) * CONTROL_DT / 6
    assert delays.mean() == pytest.approx(0.005, abs=2e-4)
    assert set(np.round(1000 * delays, 1)) == {0.0, 3.3, 6.7, 10.0}


def test_motors_pull_less_the_faster_they_turn(solo12):
    physics = built(solo12, torque_speed=True)
    limit, top = solo12.training_effort_limits[0], solo12.velocity_limits[0]
    speeds = np.zeros((3, 12))
    speeds[:, 0] = [0.25 * top, 0.75 * top, -2.0 * top]
    physics._motors.limit_torque(physics._batch, speeds)
    ranges = physics._batch.expand("actuator_forcerange")[:, 0]
    assert ranges[:, 1] == pytest.approx([limit, 0.5 * limit, limit])
    assert ranges[:, 0] == pytest.approx([-limit, -limit, 0.0])


def test_an_explicit_controller_at_1_khz_stands_as_the_implicit_one(solo12):
    heights = []
    for fields in ({}, {"explicit_pd": True, "substeps": 20}):
        physics = built(solo12, **fields)
        for _ in range(50):
            physics.step(held(solo12))
        heights.append(physics.qpos[:, 2])
    assert physics.foot_force.shape == (3, 20, 4)
    assert torch.allclose(*heights, atol=1e-3)


def test_encoders_that_are_off_move_the_joints_the_other_way(solo12):
    physics = built(solo12, joint_offset=0.03)
    usual = built(solo12)
    for _ in range(50):
        physics.step(held(solo12))
        usual.step(held(solo12))
    moved = physics.qpos[:, 7:] - usual.qpos[:, 7:]
    assert physics.joint_offset.abs().max() <= 0.03
    assert (
        torch.corrcoef(torch.stack((moved.flatten(), physics.joint_offset.flatten())))[0, 1] < -0.7
    )


def test_gains_and_loads_are_those_that_were_drawn(solo12):
    physics = built(solo12, worlds=64, gain_error=0.1, payload=0.1)
    usual = BatchPhysics(PhysicsRequest(solo12, 64, threads=1))
    usual.set_parameters(parameters(solo12, 64))
    gains = physics._batch.expand("actuator_gainprm")[:, :, 0] / np.array(solo12.stiffness)
    assert 0.9 <= gains.min() < 0.92 and 1.08 < gains.max() <= 1.1
    loads = physics._batch.expand("body_mass") - usual._batch.expand("body_mass")
    assert np.abs(loads).sum(axis=1).max() == pytest.approx(0.1 * solo12.total_mass(), rel=0.1)
    assert not np.delete(loads, physics._base, axis=1).any()
    shift = physics._batch.expand("body_ipos") - usual._batch.expand("body_ipos")
    mass = physics._batch.expand("body_mass")[:, physics._base, None]
    moment = mass * shift[:, physics._base] / loads[:, physics._base, None]
    assert np.abs(moment[:, 0]).max() < 0.1 + 0.03, "where the load sits, less the base's centre"
    again = physics._batch.expand("body_mass").copy()
    physics.set_parameters(parameters(solo12, 64))
    assert np.array_equal(again, physics._batch.expand("body_mass")), "loaded once"


def test_floors(solo12):
    tilted = built(solo12, floor_tilt=math.radians(3.0))
    gravity = tilted._batch.expand("opt.gravity")
    assert np.linalg.norm(gravity, axis=1) == pytest.approx([9.81] * 3)
    assert gravity[:, 2] == pytest.approx([-9.81 * math.cos(math.radians(3.0))] * 3)
    assert torch.allclose(tilted.down, torch.from_numpy(gravity / 9.81).float())
    stepped = built(solo12, floor_steps=0.01)
    slippery = built(solo12, slippery_foot=0.5)
    usual = built(solo12)
    ratio = (
        slippery._batch.expand("geom_friction")[:, slippery._foot_geoms, 0]
        / usual._batch.expand("geom_friction")[:, usual._foot_geoms, 0]
    )
    assert np.sort(ratio, axis=1) == pytest.approx(np.tile([0.5, 1, 1, 1], (3, 1)))
    for _ in range(50):
        stepped.step(held(solo12))
        usual.step(held(solo12))
    # hind feet stand 0.2 m behind the middle in a strip that is up, front feet where it is down
    assert (stepped.qpos[:, 2] < usual.qpos[:, 2] - 0.002).all()


def test_the_solver_and_the_joints_of_the_model(solo12):
    model = built(
        solo12, cone="elliptic", solver="pgs", joint_friction=0.02, joint_damping=0.1
    ).model
    assert (model.opt.cone, model.opt.solver) == (1, 0)
    assert model.dof_frictionloss[6:] == pytest.approx([0.06] * 12)
    assert model.dof_damping[6:] == pytest.approx([0.02] * 12)


def test_it_goes_on_bit_for_bit(solo12):
    fields = {"action_latency": 0.02, "latency_jitter": 0.5, "gain_error": 0.1}
    physics = built(solo12, **fields)
    for _ in range(5):
        physics.step(held(solo12) + 0.2)
    state = {name: value.clone() for name, value in physics.state_dict().items()}
    other = built(solo12, **fields)
    other.load_state_dict(state)
    for _ in range(5):
        physics.step(held(solo12))
        other.step(held(solo12))
    assert torch.equal(physics.qpos, other.qpos)


def test_graded_worlds_have_every_share_of_a_slope_and_of_the_joints_friction(solo12):
    """Between none and all, another one in each world, and each disturbance's own."""
    worlds = 64
    whole = {"floor_tilt": 0.05, "joint_friction": 0.02, "joint_damping": 0.1}
    physics = built(solo12, worlds, **whole, graded=True)
    slope = torch.acos(-physics.down[:, 2]).double().numpy()
    own = built(solo12, 1).model
    friction = physics._batch.expand("dof_frictionloss")[:, 6:] - own.dof_frictionloss[6:]
    damping = physics._batch.expand("dof_damping").reshape(worlds, own.nv, -1)[:, 6:, 0]
    damping = damping - own.dof_damping.reshape(own.nv, -1)[6:, 0]
    friction_share = friction / (0.02 * solo12.effort_limits())
    damping_share = damping / (0.1 * np.array(solo12.damping))
    assert np.ptp(friction_share, axis=1).max() < 1e-9
    np.testing.assert_allclose(friction_share, damping_share, atol=1e-9)
    for share in (friction_share[:, 0], slope / 0.05):
        assert -1e-9 <= share.min() < 0.1 and 0.9 < share.max() <= 1.0 + 1e-3
    assert abs(np.corrcoef(friction_share[:, 0], slope)[0, 1]) < 0.5


def test_graded_worlds_are_late_by_shares_of_the_latency(solo12):
    """A target 0.1 rad away moves the joints at once where there is no latency, and in a whole
    control step not where there is all of it.
    """
    moved, still = (built(solo12, 64, action_latency=0.02, graded=True) for _ in range(2))
    moved.step(held(solo12, 64) + 0.1)
    still.step(held(solo12, 64))
    went = (moved.qpos - still.qpos)[:, 7:].abs().amax(dim=1)
    at_once = built(solo12, 64, graded=True)
    at_once.step(held(solo12, 64) + 0.1)
    most = (at_once.qpos - still.qpos)[:, 7:].abs().amax(dim=1)
    share = went / most
    assert share.min() < 0.1 and 0.7 < share.max() <= 1.0 + 1e-3


def test_graded_worlds_stand_on_steps_of_all_heights_and_half_have_elliptic_cones(solo12):
    """A robot beside the strips stands as low as its floor."""
    worlds = 16
    stepped, flat = (
        built(solo12, worlds, floor_steps=height, cone="elliptic", graded=True)
        for height in (0.01, 0.0)
    )
    depth = -stepped._batch.expand("geom_pos")[:, stepped.model.geom("floor").id, 2]
    assert 0.0 <= depth.min() < depth.max() <= 0.01
    cones = stepped._batch.expand("opt.cone")
    assert 4 <= cones.sum() <= 12
    assert len(set(cones[::2])) == len(set(cones[1::2])) == 2, "every other world has no noise"
    qpos = torch.from_numpy(solo12.default_qpos()).float().repeat(worlds, 1)
    qpos[:, 1] = 4.0  # strips end 3 m to the side
    for physics, lower in ((stepped, depth), (flat, 0.0 * depth)):
        start = qpos.clone()
        start[:, 2] -= torch.from_numpy(lower).float()
        physics.reset(torch.arange(worlds), start, torch.zeros(worlds, 18))
        for _ in range(50):
            physics.step(held(solo12, worlds))
    np.testing.assert_allclose((flat.qpos - stepped.qpos)[:, 2], depth, atol=1e-3)
