"""A task with a gait: reference, mirror, starts inside the gait, state."""

from dataclasses import replace

import mujoco
import pytest
import torch

from lacoloco.pipelines.sim.env import LeggedEnv
from lacoloco.pipelines.sim.gait.stride import StrideReference
from lacoloco.pipelines.sim.tasks import load_task, task_from_text
from lacoloco.robots.errors import RobotError

AHEAD = torch.tensor([[0.8, 0.0, 0.0]])


def walk(h1, worlds=2, **changes):
    task = replace(load_task(h1, "walk"), noise=0.0, **changes)
    return LeggedEnv(h1, task, worlds, seed=0)


def test_feet_of_the_reference_go_back_as_fast_as_the_ground(h1):
    """While both feet stand, they move backwards under the base at the commanded speed."""
    env = walk(h1, 1)
    clock = env.gait.clock
    clock.stepping[:] = True
    stride = StrideReference(h1, torch.device("cpu"))
    model = h1.model()
    data = mujoco.MjData(model)
    feet = []
    clock.phase[:] = h1.gait.swing_share + 0.01
    for _ in range(2):
        data.qpos[:] = h1.default_qpos()
        data.qpos[7:] = stride(clock, AHEAD)[0].numpy()
        mujoco.mj_kinematics(model, data)
        feet.append([data.body(name).xpos[0] for name in h1.feet])
        clock.phase += 0.02 / h1.gait.period
    assert [(b - a) / 0.02 for a, b in zip(*feet, strict=True)] == pytest.approx(
        [-0.8] * 2, rel=2e-2
    )


def test_a_robot_in_the_mirror_acts_in_the_mirror(h1):
    """One world in the first half of the cycle, its mirror image in the second: one view."""
    env = walk(h1)
    mirror = env.gait._mirror
    joint_pos = env.physics.qpos[:1, 7:] + 0.1 * torch.randn(1, 19)
    qpos = torch.cat((env.physics.qpos[:1, :7], joint_pos), dim=1)
    image = torch.cat((qpos[:, :7], mirror.joints(joint_pos)), dim=1)
    qpos[:, 3:7] = image[:, 3:7] = torch.tensor([1.0, 0.0, 0.0, 0.0])
    both = torch.cat((qpos, image))
    env.start_from(torch.arange(2), both, torch.zeros(2, 25), torch.zeros(2, 19))
    env.command = torch.tensor([[0.5, 0.0, 0.3], [0.5, 0.0, -0.3]])
    env.gait.clock.stepping[:] = True
    env.gait.clock.phase = torch.tensor([0.2, 0.7])
    first, second = env.observe()
    assert torch.allclose(first, second, atol=1e-5)
    action = torch.randn(1, 19).repeat(2, 1)
    acted = env.gait.actual(action)
    assert torch.equal(acted[0], action[0])
    assert torch.allclose(mirror.joints(acted)[1], action[1])


def test_without_actions_the_target_is_the_reference(h1):
    env = walk(h1)
    env.step(torch.zeros(2, 19))
    assert torch.equal(env.joint_target, env.gait.joint_pos)


def test_half_of_the_walkers_begin_inside_the_gait(h1):
    task = load_task(h1, "walk")
    env = walk(h1, 64, command=replace(task.command, standing=0.0))
    in_gait = env.gait.clock.stepping
    assert 16 < int(in_gait.sum()) < 48
    ahead = env.state.lin_vel_b[in_gait, 0]
    assert torch.allclose(ahead, env.command[in_gait, 0], atol=1e-4)


def test_its_state_makes_the_next_steps_what_they_are(h1):
    env, other = walk(h1), walk(h1)
    generator = torch.Generator().manual_seed(0)
    actions = torch.randn(20, 2, 19, generator=generator)
    for action in actions[:10]:
        env.step(action)
    other.load_state_dict(env.state_dict())
    for action in actions[10:]:
        assert torch.equal(env.step(action).reward, other.step(action).reward)
        assert torch.equal(env.observe(), other.observe())


def test_a_hand_is_led_to_its_target(h1):
    """The servo's reference, played by kinematics alone, ends at the target."""
    env = LeggedEnv(h1, load_task(h1, "reach_in_place"), 8, seed=0)
    servo = env.gait._servo
    qpos = env.physics.qpos.clone()
    for _ in range(200):
        servo.advance(qpos, env.command)
        qpos[:, [7 + j for j in servo.joints]] = servo.joint_pos
    end = servo._chain(qpos)
    assert torch.linalg.vector_norm(end - env.command, dim=1).max() < 0.03


def test_a_gait_reward_without_a_gait_is_refused(h1, tmp_path):
    text = 'rewards = [{ name = "contact_schedule", weight = 1.0 }]'
    with pytest.raises(RobotError, match="gait = true"):
        task_from_text(h1, text, tmp_path / "mine.toml")


def test_a_robot_without_a_gait_is_refused(solo12, tmp_path):
    text = 'gait = true\nrewards = [{ name = "alive", weight = 1.0 }]'
    task = task_from_text(solo12, text, tmp_path / "mine.toml")
    with pytest.raises(RobotError, match=r"\[gait\]"):
        LeggedEnv(solo12, task, 2, seed=0)
