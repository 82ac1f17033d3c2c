"""MuJoCo Warp against MuJoCo's native engine, behind the same contract, on the CPU and in few
worlds.

Warp computes in single precision, so states that start equal drift apart: what is compared is one
control step from equal states, and quantities that an error cannot grow in.
"""

import math
from dataclasses import replace

import mujoco
import pytest
import torch

from lacoloco.datasets import published
from lacoloco.pipelines.errors import StageError
from lacoloco.pipelines.generation.expert_trainer import without_disturbances
from lacoloco.pipelines.policies import load_policies
from lacoloco.pipelines.sim.engines import make_physics
from lacoloco.pipelines.sim.env import LeggedEnv
from lacoloco.pipelines.sim.physics import PhysicsRequest, WorldParameters
from lacoloco.pipelines.sim.tasks import load_task
from lacoloco.robots.scene import compile_scene

pytest.importorskip("mujoco_warp", reason="needs MuJoCo Warp: pip install 'lacoloco[gpu]'")
pytestmark = pytest.mark.slow

WORLDS = 8
STANDING = torch.tensor([0, 0.8, -1.6] * 2 + [0, -0.8, 1.6] * 2)
QPOS_TOLERANCE = 1e-5  # m and rad
QVEL_TOLERANCE = 2e-4  # m/s and rad/s
FORCE_TOLERANCE = 2e-4  # of the largest force: an impact on stiff feet is many weights
TOUCHING = 2 * 0.16 * math.cos(0.8) + 0.02  # m: two leg segments and the radius of the foot


def engine(spec, name, monkeypatch, worlds=WORLDS):
    monkeypatch.setenv("LACOLOCO_PHYSICS", "warp" if name == "warp" else "")
    return make_physics(PhysicsRequest(spec, worlds, threads=1))


@pytest.fixture
def both(monkeypatch):
    """Factory of the same worlds on both engines, Warp first."""

    def factory(spec, worlds=WORLDS):
        return tuple(engine(spec, name, monkeypatch, worlds) for name in ("warp", "native"))

    return factory


@pytest.fixture
def warp(solo12, monkeypatch):
    return engine(solo12, "warp", monkeypatch)


def standing(worlds=WORLDS):
    qpos = torch.zeros(worlds, 19)
    qpos[:, 2], qpos[:, 3], qpos[:, 7:] = TOUCHING, 1.0, STANDING
    return qpos


def stand(physics, steps=50):
    worlds = physics.num_worlds
    physics.reset(torch.arange(worlds), standing(worlds), torch.zeros(worlds, 18))
    hold(physics, steps)
    return physics


def hold(physics, steps, targets=STANDING):
    for _ in range(steps):
        physics.step(targets.repeat(physics.num_worlds, 1))


def parameters(worlds=WORLDS, **changes):
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


def near_the_floor(spec, generator):
    """Tilted robots in motion, the lowest foot up to 10 mm in the floor or above it."""
    model, joints = compile_scene(spec), spec.num_joints
    qpos = torch.zeros(WORLDS, 7 + joints)
    qpos[:, 3] = 1.0
    qpos[:, 4:7] = 0.1 * torch.randn(WORLDS, 3, generator=generator)
    qpos[:, 3:7] /= qpos[:, 3:7].norm(dim=-1, keepdim=True)
    spread = 0.1 * torch.randn(WORLDS, joints, generator=generator)
    qpos[:, 7:] = torch.tensor(spec.default_joint_pos) + spread
    data = mujoco.MjData(model)
    for row in qpos:
        data.qpos[:] = row.numpy()
        mujoco.mj_kinematics(model, data)
        lowest = min(data.body(name).xpos[2] for name in spec.feet) - spec.foot_radius()
        row[2] = 0.01 * (2.0 * torch.rand((), generator=generator) - 1.0) - lowest
    return qpos, 0.5 * torch.randn(WORLDS, 6 + joints, generator=generator)


def torque_tolerance(spec):
    """N.m: what the gains make of states that differ by the tolerances above."""
    return QPOS_TOLERANCE * max(spec.stiffness) + QVEL_TOLERANCE * max(spec.damping)


def test_one_step_agrees_on_motion_torque_and_force(robot, both):
    if robot.model().dof_frictionloss.any():
        pytest.xfail(
            "with dry friction in joints a step ends 1e-4 rad apart; without it all agrees"
        )
    generator = torch.Generator().manual_seed(3)
    engines = both(robot)
    shared = parameters(
        friction=0.4 + torch.rand(WORLDS, generator=generator),
        mass_scale=0.8 + 0.4 * torch.rand(WORLDS, generator=generator),
        inertia_scale=0.8 + 0.4 * torch.rand(WORLDS, generator=generator),
        base_com_offset=0.04 * torch.rand(WORLDS, 3, generator=generator) - 0.02,
    )
    for physics in engines:
        physics.set_parameters(shared)
    touched = 0
    for _ in range(10):
        qpos, qvel = near_the_floor(robot, generator)
        targets = qpos[:, 7:] + 0.2 * torch.randn(WORLDS, robot.num_joints, generator=generator)
        for physics in engines:
            physics.reset(torch.arange(WORLDS), qpos, qvel)
            physics.step(targets)
        warp, native = engines
        assert torch.allclose(warp.qpos, native.qpos, atol=QPOS_TOLERANCE)
        assert torch.allclose(warp.qvel, native.qvel, atol=QVEL_TOLERANCE)
        assert torch.allclose(warp.torque, native.torque, atol=torque_tolerance(robot))
        tolerance = FORCE_TOLERANCE * max(robot.weight(), float(native.foot_force.max()))
        assert torch.allclose(warp.foot_force, native.foot_force, atol=tolerance)
        assert torch.allclose(warp.body_force, native.body_force, atol=tolerance)
        touched += int((native.foot_force > 1.0).sum())
    assert touched > 100  # or the forces compared above were all zero


def test_a_fall_is_felt_alike(both, solo12):
    """Dropped on its back. Only roughly: the engines turn the friction pyramid of a capsule
    differently.
    """
    forces = []
    for physics in both(solo12, 2):
        qpos = standing(2)
        qpos[:, 2], qpos[:, 3], qpos[:, 4] = 0.06, 0.0, 1.0
        physics.reset(torch.arange(2), qpos, torch.zeros(2, 18))
        hold(physics, 5)
        forces.append(physics.body_force)
    warp, native = forces
    assert native.max() > 1.0
    assert torch.allclose(warp, native, rtol=0.1, atol=0.5)


def test_feet_carry_the_weight_in_every_substep(warp, solo12):
    scale = torch.linspace(0.8, 1.2, WORLDS)
    warp.set_parameters(parameters(mass_scale=scale))
    total = stand(warp, 100).foot_force.sum(dim=-1)
    expected = (scale * solo12.weight())[:, None].expand_as(total)
    assert torch.allclose(total, expected, rtol=3e-2)
    assert not warp.body_force.any()


def test_a_slippery_world_slides_as_far_as_on_the_native_engine(both, solo12):
    slides = []
    for physics in both(solo12, 2):
        physics.set_parameters(parameters(2, friction=torch.tensor([0.1, 1.2])))
        start = stand(physics).qpos[:, 0]
        kick = torch.zeros(2, 6)
        kick[:, 0] = 0.6
        physics.push(torch.arange(2), kick)
        hold(physics, 50)
        slides.append(physics.qpos[:, 0] - start)
    warp, native = slides
    assert warp[0] > 0.1 > 0.05 > warp[1]
    assert torch.allclose(warp, native, atol=0.01)


@pytest.mark.parametrize("masked", [False, True])
def test_reset_touches_only_its_worlds_also_world_zero(warp, masked):
    """Worlds share Warp's contact list, which its own `reset_data` empties along with world 0."""
    stand(warp, 10)
    before = warp.state_dict()
    hold(warp, 5)
    untouched = warp.qpos, warp.foot_force
    warp.load_state_dict(before)
    chosen = torch.tensor([0, 3])
    qpos, qvel = standing(2), torch.full((2, 18), 0.25)
    qpos[:, 0] = torch.tensor([5.0, 6.0])
    if masked:
        mask = torch.zeros(WORLDS, dtype=torch.bool)
        mask[chosen] = True
        every, rates = standing(), torch.full((WORLDS, 18), 0.25)
        every[chosen] = qpos
        warp.reset(mask, every, rates)
    else:
        warp.reset(chosen, qpos, qvel)
    assert torch.equal(warp.qpos[chosen], qpos)
    assert torch.equal(warp.qvel[chosen], qvel)
    hold(warp, 5)
    others = [1, 2, 4, 5, 6, 7]
    assert torch.equal(warp.qpos[others], untouched[0][others])
    assert torch.equal(warp.foot_force[others], untouched[1][others])
    assert not torch.allclose(warp.qpos[chosen], untouched[0][chosen], atol=0.1)


def test_a_reset_world_forgets_all_of_its_past(warp):
    stand(warp, 3)
    warp.reset(torch.tensor([0]), standing(1), torch.full((1, 18), 0.5))
    hold(warp, 7)
    stand(warp, 7)
    assert torch.equal(warp.qpos, warp.qpos[:1].expand_as(warp.qpos))


def test_masks_push_as_numbers_do(both, solo12):
    """On both engines: with a mask, every world has a row of values, used or not."""
    kick = torch.arange(12.0).view(2, 6) / 10
    for physics in both(solo12, 2):
        stand(physics, 1)
        before = physics.qvel
        physics.push(torch.tensor([False, True]), kick)
        assert torch.equal(physics.qvel[0], before[0])
        assert torch.allclose(physics.qvel[1, :6], before[1, :6] + kick[1], atol=1e-6)


def test_diverged_worlds_are_noticed_restarted_and_never_spread(warp):
    stand(warp)
    state = warp.state_dict()
    hold(warp, 11)
    healthy = warp.qpos
    warp.load_state_dict(state)
    qpos, qvel, targets = standing(3), torch.zeros(3, 18), STANDING.repeat(WORLDS, 1)
    qpos[0, 2], qpos[1, 9], qvel[2, 8], targets[6, 4] = torch.nan, torch.inf, 1e12, torch.nan
    warp.reset(torch.tensor([1, 2, 4]), qpos, qvel)
    warp.step(targets)
    assert torch.nonzero(warp.diverged).flatten().tolist() == [1, 2, 4, 6]
    for tensor in (warp.qpos, warp.qvel, warp.foot_force, warp.body_force, warp.torque):
        assert torch.isfinite(tensor).all()
    hold(warp, 10)
    assert not warp.diverged.any()
    others = [0, 3, 5, 7]
    assert torch.equal(warp.qpos[others], healthy[others])


def test_state_dict_goes_on_bit_for_bit(warp):
    stand(warp, 4)
    state = warp.state_dict()
    hold(warp, 6, STANDING - 0.2)
    expected = warp.qpos, warp.qvel, warp.foot_force
    hold(warp, 3)
    warp.load_state_dict(state)
    hold(warp, 6, STANDING - 0.2)
    for tensor, wanted in zip((warp.qpos, warp.qvel, warp.foot_force), expected, strict=True):
        assert torch.equal(tensor, wanted)


def returns(spec, physics, policy, steps=75):
    """(N,) returns of the walking task; the same seed gives the same starts, commands and
    worlds.
    """
    task = replace(without_disturbances(load_task(spec, "walk")), episode_s=60.0)
    env = LeggedEnv(spec, task, physics.num_worlds, seed=5, physics=physics)
    total = torch.zeros(physics.num_worlds)
    alive = torch.ones(physics.num_worlds, dtype=torch.bool)
    for _ in range(steps):
        step = env.step(policy(env.observe()))
        alive &= ~step.fell
        total += step.reward * alive
    return total


def test_the_same_policy_earns_the_same_on_both_engines(both, solo12):
    """The published walking expert, world by world from equal starts: it corrects what the engines
    do differently.
    """
    _, policies = load_policies(published.find("solo12-experts"), "walk")
    warp, native = (returns(solo12, physics, policies["walk"]) for physics in both(solo12, 16))
    standard_error = float(native.std()) / len(native) ** 0.5
    assert abs(float(warp.mean() - native.mean())) < 2.0 * standard_error
    # Pairs tell more: no world may earn much more on one engine, which the spread between worlds
    # would hide.
    difference = warp - native
    assert float(difference.abs().mean()) < 0.1 * float(native.std())
    (idle,) = (
        returns(solo12, physics, lambda obs: torch.zeros(16, 12))
        for physics in both(solo12, 16)[1:]
    )
    assert float((idle - native).abs().mean()) > 0.5 * float(native.std()), "a policy matters"


@pytest.mark.parametrize(
    ("variable", "size"), [("LACOLOCO_WARP_NJMAX", 8), ("LACOLOCO_WARP_NCONMAX", 1)]
)
def test_running_out_of_room_is_an_error_that_names_the_number(solo12, monkeypatch, variable, size):
    monkeypatch.setenv(variable, str(size))
    monkeypatch.setattr("lacoloco.pipelines.sim.mujoco_warp.LOOK_EVERY", 4)
    physics = engine(solo12, "warp", monkeypatch, worlds=2)
    with pytest.raises(StageError, match=f"{variable}={2 * size}"):
        stand(physics, 20)
