"""How episodes begin."""

from dataclasses import replace

import pytest
import torch

from lacoloco.pipelines.sim.env import LeggedEnv
from lacoloco.pipelines.sim.physics import CONTROL_DT
from lacoloco.pipelines.sim.tasks import load_task
from lacoloco.robots.errors import RobotError


def still(robot, stood_s):
    task = load_task(robot, "reach")
    reset = replace(task.reset, heading=3.0, lin_vel=0.0, ang_vel=0.0, stood_s=stood_s)
    return LeggedEnv(robot, replace(task, reset=reset, noise=0.0), 32, seed=0)


def test_a_robot_that_has_stood_there_stays_where_it_is(solo12):
    """It has sagged into its motors already, whatever its heading: nothing moves any more."""
    fresh, stood = still(solo12, (0.0, 0.0)), still(solo12, (1.5, 2.0))
    moved = []
    for env in (fresh, stood):
        before = env.physics.qpos
        for _ in range(10):
            env.step(torch.zeros(32, env.num_actions))
        moved.append((env.physics.qpos[:, 7:] - before[:, 7:]).abs().max())
    assert moved[1] < 0.2 * moved[0]
    assert stood.physics.qpos[:, 2].max() < fresh.physics.qpos[:, 2].max() + 1e-3


def test_who_falls_by_itself_starts_before_it_does(h1):
    """An H1 that only holds its pose tips over within two seconds."""
    env = still(h1, (2.0, 2.0))
    assert env.state.gravity_b[:, 2].max() < -0.99
    for _ in range(round(2.0 / CONTROL_DT)):
        env.step(torch.zeros(32, env.num_actions))
    assert env.state.gravity_b[:, 2].max() > -0.9


def test_who_has_stood_there_is_asked_for_the_same(solo12):
    fresh, stood = still(solo12, (0.0, 0.0)), still(solo12, (1.0, 1.0))
    assert torch.equal(fresh.command, stood.command)
    assert torch.allclose(fresh.physics.qpos[:, :2], stood.physics.qpos[:, :2], atol=1e-5)


def test_episodes_start_at_different_moments_of_standing(solo12):
    env = still(solo12, (0.0, 0.4))
    joint_pos = env.physics.qpos[:, 7:]
    assert len(torch.unique(joint_pos.round(decimals=4), dim=0)) > 8


@pytest.mark.parametrize("wrong", ["[-0.1, 1.0]", "[1.0, 0.5]", "[0.0, 11.0]"])
def test_times_of_standing_are_checked(solo12, tmp_path, wrong):
    from lacoloco.pipelines.sim.tasks import load_task_file

    file = tmp_path / "own.toml"
    file.write_text(
        f"reset = {{ stood_s = {wrong} }}\nrewards = [{{ name = 'reach', weight = 1.0 }}]\n"
        "command = { type = 'target', x = [0.0, 1.0], y = [0.0, 1.0], z = [0.1, 0.2] }\n"
    )
    with pytest.raises(RobotError, match="stood_s"):
        load_task_file(solo12, file)
