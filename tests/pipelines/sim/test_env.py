"""One environment: observations, time, falls, pushes, commands; every step as it was before a
reset.
"""

import math
from dataclasses import replace

import pytest
import torch

from lacoloco.pipelines.sim.env import LeggedEnv
from lacoloco.pipelines.sim.physics import CONTROL_DT
from lacoloco.pipelines.sim.randomisation import (
    NO_RANDOMISATION,
    Randomisation,
    draw_parameters,
    widened,
)
from lacoloco.pipelines.sim.registered import Registered
from lacoloco.pipelines.sim.rewards import REWARDS, RewardTerm
from lacoloco.pipelines.sim.state import layout, noise_scale, style_frame
from lacoloco.pipelines.sim.tasks import imitate_task, load_task
from lacoloco.robots.registry import load_robot

WORLDS = 4


def task_of(name, spec):
    return load_task(spec, name)


def idle(env, steps=1):
    for _ in range(steps):
        step = env.step(torch.zeros(env.num_worlds, env.num_actions))
    return step


def throw_on_its_back(env, world):
    qpos, qvel = env.physics.qpos[[world]].clone(), torch.zeros(1, 6 + env.num_actions)
    qpos[:, 2], qpos[:, 3:7] = 0.05, torch.tensor([0.0, 1.0, 0.0, 0.0])
    qvel[:, 2] = -2.0
    env.physics.reset(torch.tensor([world]), qpos, qvel)


@pytest.mark.parametrize("name", load_robot("solo12").tasks)
def test_both_robots_live_in_every_task(robot, name, make_motions):
    task = task_of(name, robot)
    env = LeggedEnv(robot, task, WORLDS, seed=1, motions=make_motions(robot))
    joints, actions = robot.num_joints, robot.num_joints + task.memory
    width = 10 + 2 * joints + actions + (0 if name == "imitate" else 3) + (3 if task.gait else 0)
    generator = torch.Generator().manual_seed(0)
    for _ in range(30):
        step = env.step(torch.randn(WORLDS, actions, generator=generator))
        assert env.observe().shape == (WORLDS, width)
        assert torch.isfinite(env.observe()).all()
        assert torch.isfinite(step.reward).all()
        for constraint in task.constraints:
            assert torch.isfinite(step.violations[constraint.name]).all()
        env.reset(step.done)
    assert env.diverged_total == 0


@pytest.mark.parametrize(
    ("name", "widths"),
    [("imitate", (46, 70)), ("reach", (49, 73)), ("reach_in_place", (49, 73)), ("walk", (49, 73))],
)
def test_widths_of_the_observations(solo12, h1, name, widths):
    for spec, expected in zip((solo12, h1), widths, strict=True):
        env = LeggedEnv(spec, task_of(name, spec), 2, seed=0)
        assert env.observe().shape == (2, expected)
        assert layout(env.terms)[-1]["slice"][1] == expected
        assert env.frame().shape == (2, 10 + 2 * spec.num_joints)


def test_slices_hold_what_their_names_say(make_env, solo12):
    env = make_env(load_task(solo12, "reach"), noise=0.0)
    action = torch.randn(WORLDS, 12, generator=torch.Generator().manual_seed(3))
    env.step(action)
    seen, state = env.observe(), env.state
    part = {row["name"]: seen[:, slice(*row["slice"])] for row in layout(env.terms)}
    assert torch.equal(part["base_height"][:, 0], state.root_pos[:, 2])
    assert torch.equal(part["projected_gravity"], state.gravity_b)
    assert torch.equal(part["base_lin_vel"], state.lin_vel_b)
    assert torch.equal(part["base_ang_vel"], env.physics.qvel[:, 3:6])
    assert torch.equal(part["joint_pos"], env.physics.qpos[:, 7:])
    assert torch.equal(part["joint_vel"], env.physics.qvel[:, 6:])
    assert torch.equal(part["last_action"], action)
    distance = (env.command - state.root_pos).norm(dim=-1)
    assert torch.allclose(part["target"].norm(dim=-1), distance, atol=1e-5)
    assert torch.equal(seen[:, :34], style_frame(state))


def test_noise_stays_within_its_range_and_fills_it(make_env):
    env, noise = make_env(worlds=64), []
    idle(env)
    clean = torch.cat([env.frame(), env.action], dim=-1)
    for _ in range(20):
        noise.append(env.observe() - clean)
    noise = torch.cat(noise)
    scale = noise_scale(env.terms)
    assert (noise.abs() <= scale * 1.001 + 1e-6).all()
    assert torch.allclose(noise.amax(0), scale, rtol=0.02, atol=1e-6)
    assert torch.allclose(noise.amin(0), -scale, rtol=0.02, atol=1e-6)
    assert torch.equal(env.frame(), clean[:, :34]), "the frame itself stays clean"


def test_actions_are_offsets_from_the_default_pose(make_env, solo12, monkeypatch):
    env, targets = make_env(load_task(solo12, "walk")), []
    step = env.physics.step
    monkeypatch.setattr(env.physics, "step", lambda value: (targets.append(value), step(value)))
    action = torch.linspace(-1, 1, 12).repeat(WORLDS, 1)
    env.step(action)
    expected = torch.tensor(solo12.default_joint_pos) + solo12.walk_action_scale * action
    assert torch.allclose(targets[0], expected)


def test_a_time_out_comes_after_exactly_its_seconds(make_env):
    env = make_env(episode_s=5 * CONTROL_DT)
    for count in range(1, 6):
        step = idle(env)
        assert step.timed_out.tolist() == [count == 5] * WORLDS
        assert not step.fell.any()
    env.reset(torch.tensor([True, False, False, False]))
    assert env.steps.tolist() == [0, 5, 5, 5]
    assert idle(env).timed_out.tolist() == [False, True, True, True]


def test_a_fall_is_not_a_time_out_even_in_the_last_step(make_env):
    env = make_env(episode_s=2 * CONTROL_DT)
    idle(env)
    throw_on_its_back(env, 1)
    step = idle(env)
    assert step.fell.tolist() == [False, True, False, False]
    assert step.timed_out.tolist() == [True, False, True, True]
    assert step.done.all()


def test_a_step_describes_the_state_before_the_reset(make_env):
    """Bug B2: the original's transition of a fall ends in the state after the reset."""
    env = make_env()
    throw_on_its_back(env, 2)
    step = idle(env)
    fallen = env.frame()
    assert step.fell[2]
    assert fallen[2, 3] > 0.9, "gravity towards the back of the robot"
    env.reset(step.done)
    assert env.frame()[2, 3] < -0.9
    assert fallen[2, 3] > 0.9, "the old frame stays what it was"


def test_only_undesired_contacts_that_the_task_names_end_an_episode(make_env, solo12, monkeypatch):
    for strict in (False, True):
        env = make_env(fall_on_undesired=strict)
        step = env.physics.step

        def touching_with_a_thigh(targets, env=env, step=step):
            step(targets)
            env.physics.body_force[1, env.physics.monitored.index("FR_UPPER_LEG")] = 1.5
            env.physics.body_force[3, 0] = 0.9  # the base, but too lightly to count

        monkeypatch.setattr(env.physics, "step", touching_with_a_thigh)
        assert idle(env).fell.tolist() == [False, strict, False, False]


@pytest.mark.parametrize(
    ("limit", "expected"), [(None, [False] * 4), (1.0, [False, True, True, False])]
)
def test_tipping_over_is_a_fall_where_the_task_says_so(make_env, limit, expected):
    """Whichever way, and long before the base touches the ground."""
    env = make_env(fall_tilt=limit)
    qpos, tilts = env.physics.qpos.clone(), torch.tensor([0.0, 1.2, -1.2, 0.8])
    qpos[:, 2] = 1.0
    qpos[:, 3:7] = torch.stack(
        (torch.cos(tilts / 2), torch.sin(tilts / 2), 0 * tilts, 0 * tilts), dim=1
    )
    env.physics.reset(torch.arange(4), qpos, torch.zeros(4, 6 + env.num_actions))
    assert idle(env).fell.tolist() == expected


def test_pushes_add_to_the_velocity_after_the_step_was_judged(make_env, solo12):
    pushes = Randomisation(push=0.3, push_interval_s=(0.1, 0.1))
    calm = replace(pushes, push=0.0)
    task = replace(load_task(solo12, "reach"), constraints=load_task(solo12, "walk").constraints)
    pushed, still = (make_env(task, worlds=16, randomisation=r) for r in (pushes, calm))
    for _ in range(4):
        idle(pushed)
        idle(still)
        assert torch.equal(pushed.physics.qvel, still.physics.qvel)
    first, second = idle(pushed), idle(still)
    kick = pushed.physics.qvel - still.physics.qvel
    assert torch.equal(first.reward, second.reward)
    assert torch.equal(first.violations["joint_velocity"], second.violations["joint_velocity"])
    assert (kick[:, [0, 1, 3, 4, 5]].abs() > 1e-4).all(dim=-1).float().mean() > 0.8
    assert (kick[:, :6].abs() <= 0.3 + 1e-6).all()
    assert kick[:, 2].abs().max() == 0.0
    assert kick[:, 6:].abs().max() == 0.0
    assert torch.equal(pushed.physics.qpos, still.physics.qpos)
    assert torch.allclose(pushed.state.ang_vel_b, pushed.physics.qvel[:, 3:6])


def test_the_target_of_the_reach_task_stays_for_the_whole_episode(make_env, solo12):
    env = make_env(load_task(solo12, "reach"), episode_s=0.4)
    target = env.command.clone()
    for _ in range(20):
        idle(env)
        assert torch.equal(env.command, target)


def test_commands_change_when_they_are_due(make_env, solo12):
    env = make_env(load_task(solo12, "reach_in_place"), resample_s=(0.1, 0.1))
    seen = [env.command.clone()]
    for _ in range(11):
        idle(env)
        seen.append(env.command.clone())
    changed = [not torch.equal(a, b) for a, b in zip(seen[:-1], seen[1:], strict=True)]
    assert changed == [False] * 4 + [True] + [False] * 4 + [True, False]


def test_rewards_are_weighted_and_paid_per_second(make_env, monkeypatch):
    """Bug B16: clipped at zero, a penalty is only ever worth what else was earned."""
    for name, value in (("two", 2.0), ("one", 1.0)):
        constant = Registered(lambda env, value=value: torch.full((WORLDS,), value))
        monkeypatch.setitem(REWARDS, name, constant)
    rewards = (RewardTerm("two", 1.5), RewardTerm("one", -5.0))
    assert torch.allclose(idle(make_env(rewards=rewards)).reward, torch.tensor(-2.0 * CONTROL_DT))
    clipped = make_env(rewards=rewards, clip_reward=True)
    assert idle(clipped).reward.tolist() == [0.0] * WORLDS


def test_a_diverged_world_is_a_fall_that_means_nothing(make_env, solo12, in_a_temporary_folder):
    """Neither its rewards nor its margins: constraints keep running maxima over all worlds."""
    task = replace(load_task(solo12, "walk"), randomisation=NO_RANDOMISATION)
    env, healthy = make_env(task), make_env(task)
    qvel = env.physics.qvel[[1]].clone()
    qvel[0, 8] = 1e9
    env.physics.reset(torch.tensor([1]), env.physics.qpos[[1]], qvel)
    step, other = idle(env), idle(healthy)
    assert step.valid.tolist() == [True, False, True, True]
    assert step.fell[1]
    assert env.diverged_total == 1
    assert step.reward[1] == 0.0
    for name, margin in step.violations.items():
        assert (margin[1] <= 0.0).all(), name
        assert torch.equal(margin[[0, 2, 3]], other.violations[name][[0, 2, 3]]), name
    env.reset(step.done)
    assert idle(env).valid.all()
    assert torch.isfinite(env.observe()).all()


def test_staggered_episodes_end_at_different_times(make_env):
    env = make_env(worlds=256)
    env.stagger()
    assert int(env.steps.min()) < 25
    assert 475 < int(env.steps.max()) < env.task.episode_steps
    assert 220 < float(env.steps.float().mean()) < 280


def test_the_frame_of_a_step_is_that_before_a_push(make_env):
    env = make_env(worlds=8)
    env._push_at.fill_(2)
    first, second = idle(env), idle(env)
    assert torch.equal(first.frame, second.frame) is False
    moved = (env.frame() - second.frame)[:, 4:10].abs().amax(dim=1)
    assert (moved > 1e-4).all(), "the push is in the state"
    assert torch.equal(env.frame()[:, 10:22], second.frame[:, 10:22])
    third = idle(env)
    assert torch.equal(third.frame, env.frame())


def test_every_world_may_have_its_own_length_noise_and_share_of_clips(make_env, solo12, motions):
    task = imitate_task(solo12, constrained=False)
    env = make_env(
        replace(task, reset=replace(task.reset, clip_share=1.0)), worlds=6, motions=motions
    )
    env.episode_steps[:3], env.noise[::2], env.clip_share[3:] = 2, 0.0, 0.0
    env.steps.zero_()
    clean = (env.observe()[:, :34] - env.frame()).abs().amax(dim=1) == 0.0
    assert clean.tolist() == [True, False] * 3
    idle(env)
    assert idle(env).timed_out.tolist() == [True] * 3 + [False] * 3
    env.reset(torch.ones(6, dtype=torch.bool))
    standing = env.state.joint_vel.abs().amax(dim=1) == 0.0
    assert standing.tolist() == [False] * 3 + [True] * 3
    env.stagger()
    assert (env.steps < env.episode_steps).all()


@pytest.mark.parametrize("factor", [1.0, 1.5])
def test_a_widened_randomisation_spreads_further_around_the_same_middle(factor):
    usual = Randomisation(inertia_scale=(0.9, 1.1), base_com=0.02, push=0.1)
    wide = widened(usual, factor)
    assert wide.mass_scale == pytest.approx((1.0 - 0.2 * factor, 1.0 + 0.2 * factor))
    assert wide.inertia_scale == pytest.approx((1.0 - 0.1 * factor, 1.0 + 0.1 * factor))
    assert (wide.base_com, wide.push) == pytest.approx((0.02 * factor, 0.1 * factor))
    assert math.prod(wide.friction) == pytest.approx(0.4 * 1.5)
    assert wide.friction[1] / wide.friction[0] == pytest.approx((1.5 / 0.4) ** factor)
    assert wide.contact_time == pytest.approx((1.0, 1.5**factor))
    assert math.prod(wide.foot_friction) == pytest.approx(0.99)
    assert widened(NO_RANDOMISATION, factor) == NO_RANDOMISATION


def test_state_dict_goes_on_bit_for_bit(make_env, solo12, motions):
    task = replace(load_task(solo12, "reach_in_place"), resample_s=(0.04, 0.1), episode_s=0.2)
    task = replace(task, randomisation=Randomisation(push_interval_s=(0.04, 0.1)))
    task = replace(task, reset=replace(task.reset, clip_share=0.5))

    def live(env, steps, seed):
        generator, seen = torch.Generator().manual_seed(seed), []
        for _ in range(steps):
            step = env.step(torch.randn(WORLDS, 12, generator=generator))
            env.reset(step.done)
            env.redraw(step.done)
            seen += [env.observe(), step.reward, *step.violations.values()]
        return seen

    first = make_env(task, motions=motions)
    live(first, 7, seed=0)
    state = {k: v.clone() if torch.is_tensor(v) else v for k, v in first.state_dict().items()}
    state["feet"] = {key: value.clone() for key, value in state["feet"].items()}
    expected = live(first, 15, seed=1)
    second = make_env(task, motions=motions)
    live(second, 3, seed=2)
    second.load_state_dict(state)
    for ours, theirs in zip(live(second, 15, seed=1), expected, strict=True):
        assert torch.equal(ours, theirs)


def test_other_robots_take_over_where_the_others_were(make_env):
    env = make_env(task=None)
    env.step(torch.randn(WORLDS, 12))
    before, parameters = env.physics.state_dict()["rows"].clone(), env.parameters
    mask = torch.tensor([True, False, True, False])
    env.redraw(mask)
    assert torch.equal(env.physics.state_dict()["rows"], before)
    for name, values in env.parameters.columns().items():
        changed = (values != parameters.columns()[name]).view(WORLDS, -1).any(dim=1)
        assert torch.equal(changed, mask), name
    untouched = make_env(task=None)
    untouched.load_state_dict(env.state_dict())
    untouched.redraw(~torch.ones_like(mask))
    action = torch.zeros(WORLDS, 12)
    env.step(action), untouched.step(action)
    assert torch.equal(env.physics.qpos, untouched.physics.qpos)


def test_seeds_decide_everything_that_is_random(make_env):
    first, same, other = (make_env(seed=seed) for seed in (5, 5, 6))
    assert torch.equal(first.observe(), same.observe())
    assert not torch.equal(first.physics.qpos, other.physics.qpos)


def test_parameters_are_drawn_from_their_ranges(make_env):
    config = Randomisation(inertia_scale=(0.9, 1.1), base_com=0.02)
    drawn = draw_parameters(config, 2000, 4, torch.Generator().manual_seed(0))
    assert drawn.foot_friction.shape == (2000, 4)
    for values, (low, high) in (
        (drawn.friction, config.friction),
        (drawn.foot_friction, config.foot_friction),
        (drawn.contact_time, config.contact_time),
        (drawn.contact_damping, config.contact_damping),
        (drawn.mass_scale, config.mass_scale),
        (drawn.inertia_scale, config.inertia_scale),
        (drawn.base_com_offset, (-0.02, 0.02)),
    ):
        assert low <= float(values.min()) < low + 0.05 * (high - low)
        assert high - 0.05 * (high - low) < float(values.max()) <= high + 1e-6
    # Independent of each other.
    assert abs(float(torch.corrcoef(torch.stack([drawn.friction, drawn.mass_scale]))[0, 1])) < 0.1
    plain = draw_parameters(NO_RANDOMISATION, 3, 4, torch.Generator())
    assert plain.friction.tolist() == plain.mass_scale.tolist() == [1.0] * 3
    assert not plain.base_com_offset.any()
