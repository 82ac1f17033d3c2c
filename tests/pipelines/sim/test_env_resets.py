"""How episodes of an environment start: on the ground, from clips, and only where asked."""

from dataclasses import replace

import mujoco
import numpy as np
import pytest
import torch

from lacoloco.datasets.motion_library import MotionLibrary
from lacoloco.pipelines.sim.env import LeggedEnv
from lacoloco.pipelines.sim.randomisation import NO_RANDOMISATION
from lacoloco.pipelines.sim.tasks import imitate_task, load_task
from lacoloco.robots.registry import load_robot
from lacoloco.robots.scene import compile_scene

WORLDS = 4


def test_feet_of_a_new_episode_touch_the_ground_without_entering_it(robot):
    """Bug B7 of the original: its robot starts 1.5 cm inside the floor and is thrown out of it."""
    task = imitate_task(robot, constrained=False)
    start = replace(task.reset, clip_share=0.0, joint_scale=(1.0, 1.0), lin_vel=0.0, ang_vel=0.0)
    env = LeggedEnv(robot, replace(task, reset=start, randomisation=NO_RANDOMISATION), 2, seed=0)
    held = torch.zeros(2, env.num_actions)
    env.step(held)
    force = env.physics.foot_force[:, 0]
    # Thrown out, feet would be pressed with a multiple of the weight in the first substep.
    assert float(force.sum(-1).max()) < 0.5 * robot.weight()
    env.step(held)
    assert float(env.physics.foot_force[:, -1].sum(-1).min()) > 0.1 * robot.weight()


def test_reset_touches_only_the_worlds_of_its_mask(make_env, solo12):
    env = make_env(load_task(solo12, "reach"))
    env.step(torch.ones(WORLDS, 12))
    env.feet.air_time += 1.0
    before = {name: getattr(env, name).clone() for name in ("steps", "action", "command")}
    qpos = env.physics.qpos
    env.reset(torch.tensor([False, True, False, True]))
    kept = [0, 2]
    for name, value in before.items():
        assert torch.equal(getattr(env, name)[kept], value[kept]), name
        assert not torch.equal(getattr(env, name)[[1, 3]], value[[1, 3]]), name
    assert torch.equal(env.physics.qpos[kept], qpos[kept])
    assert not torch.allclose(env.physics.qpos[[1, 3]], qpos[[1, 3]], atol=1e-3)
    assert env.action[[1, 3]].abs().max() == 0.0
    assert env.feet.air_time[[1, 3]].max() == 0.0 < env.feet.air_time[kept].min()


def test_clip_starts_move_as_the_clip_does_whatever_their_heading(make_env, motions):
    """Bug B5: the original writes base-frame velocities as world-frame ones, or none at all."""
    task = imitate_task(make_env().spec, constrained=False)
    env = make_env(
        worlds=64,
        motions=motions,
        reset=replace(task.reset, clip_share=1.0),
        randomisation=NO_RANDOMISATION,
    )
    state = env.state
    expected = torch.tensor([0.4, 0.0, 0.0]).repeat(64, 1)
    assert torch.allclose(state.lin_vel_b, expected, atol=5e-3)
    assert torch.allclose(state.ang_vel_b[:, 2], torch.tensor(0.5), atol=5e-3)
    # In the world they move all ways: every quarter of the compass has some.
    world = env.physics.qvel[:, :2]
    angle = torch.atan2(world[:, 1], world[:, 0])
    assert (torch.histc(angle, 4, -torch.pi, torch.pi) >= 4).all()
    assert torch.allclose(state.root_pos[:, 2], torch.tensor(env.spec.default_height()), atol=1e-4)
    swing = (state.joint_pos - env.default_joint_pos).abs()
    assert 0.05 < float(swing.max()) <= 0.1001
    # Joint velocities come along: 8 rad/s x 0.1 rad.
    assert 0.5 < float(state.joint_vel.abs().max()) < 0.85


def test_who_starts_in_a_clip_has_just_done_what_led_there(robot, make_clips):
    """The policy sees its last action; in the midst of a step it has not been zero."""
    task = imitate_task(robot, constrained=False)
    task = replace(task, reset=replace(task.reset, clip_share=1.0), randomisation=NO_RANDOMISATION)
    clips = []
    for clip in make_clips(robot):
        ahead = clip.joint_pos + 0.01 * clip.joint_vel
        memory = np.tile([0.5, 0.0, 1.0], (clip.frames, 1))
        clips.append(replace(clip, joint_target=ahead, gait_memory=memory))
    env = LeggedEnv(robot, task, 64, seed=0, motions=MotionLibrary(clips))
    joints = robot.num_joints
    asked = env.default_joint_pos + task.action_scale * env.action[:, :joints]
    # The nearest frame a control step earlier, or the first one.
    earlier = env.state.joint_pos - 0.01 * env.state.joint_vel
    assert (asked - earlier).abs().max() < 0.017
    assert (asked - env.default_joint_pos).abs().max() > 0.09
    assert torch.equal(
        env.action[:, joints:], torch.tensor([[0.5, 0.0, 1.0]])[:, : task.memory].expand(64, -1)
    )


def test_the_share_of_clip_starts_is_as_asked(make_env, motions, solo12):
    task = imitate_task(solo12, constrained=False)
    env = make_env(worlds=400, motions=motions, reset=replace(task.reset, clip_share=0.25))
    from_clip = (env.state.lin_vel_b[:, 0] - 0.4).abs() < 5e-3
    assert 0.18 < float(from_clip.float().mean()) < 0.33


def test_without_default_starts_nothing_breaks(make_env, motions, solo12):
    """Bug B13: the original cannot reset when no world starts from the default pose."""
    reset = replace(imitate_task(solo12, constrained=False).reset, clip_share=1.0)
    env = make_env(motions=motions, reset=reset)
    env.reset(torch.tensor([False, True, False, False]))
    assert torch.isfinite(env.observe()).all()


@pytest.mark.parametrize("robot", ["solo12", "h1"])
def test_b7_spread_joint_angles_start_with_the_feet_on_the_ground_not_in_it(robot):
    """B7: the default pose's height puts other joint angles up to 2 cm (H1: 6 cm) inside the
    floor.
    """
    spec = load_robot(robot)
    task = replace(load_task(spec, "walk"), noise=0.0, randomisation=NO_RANDOMISATION)
    env = LeggedEnv(spec, task, 16, seed=0)
    model = compile_scene(spec)
    data = mujoco.MjData(model)
    for qpos in env.physics.qpos.numpy():
        data.qpos[:] = qpos
        mujoco.mj_forward(model, data)
        deepest = min((contact.dist for contact in data.contact if 0 in contact.geom), default=0.0)
        assert deepest > -1e-4
