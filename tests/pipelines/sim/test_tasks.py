"""Tasks are data: every mistake in a table is one line that names file and key."""

import re
from dataclasses import replace

import pytest
import torch

from lacoloco.pipelines.sim.commands import HeadingCommand, TargetCommand, VelocityCommand
from lacoloco.pipelines.sim.constraints import CONSTRAINTS
from lacoloco.pipelines.sim.env import LeggedEnv
from lacoloco.pipelines.sim.rewards import REWARDS
from lacoloco.pipelines.sim.tasks import imitate_task, load_task, load_task_file
from lacoloco.robots.errors import RobotError

HEADING = """
episode_s = 4.0
command = { type = "heading", max_angle = 2.0 }
rewards = [
  { name = "track_heading", weight = 1.0, variance = 0.25 },
  { name = "tilt", weight = -0.1 },
]
constraints = [{ name = "foot_force", max_p = 0.1 }]
"""


@pytest.fixture
def write(tmp_path):
    def write(text, name="turn.toml"):
        path = tmp_path / name
        path.write_text(text)
        return path

    return write


def test_every_robot_brings_the_papers_tasks(robot):
    kinds = {"walk": VelocityCommand, "reach_in_place": TargetCommand, "reach": TargetCommand}
    for name, kind in kinds.items():
        task = load_task(robot, name)
        assert isinstance(task.command, kind)
        assert {term.name for term in task.rewards} <= set(REWARDS)
        assert {constraint.name for constraint in task.constraints} <= set(CONSTRAINTS)
    assert load_task(robot, "imitate").command is None
    assert imitate_task(robot, constrained=False).constraints == ()


def test_forces_are_limited_by_the_robots_weight_where_no_limit_is_said(solo12):
    (constraint,) = imitate_task(solo12, constrained=True).constraints
    assert constraint.limit == solo12.foot_force_limit()


def test_every_motor_has_its_own_limits_where_no_limit_is_said(solo12, write):
    effort, speed = '"foot_force"', '"torque", max_p = 0.1 }, { name = "joint_velocity"'
    task = load_task_file(solo12, write(HEADING.replace(effort, speed)))
    uneven = replace(solo12, velocity_limits=tuple(range(1, 13)))
    assert [c.limit for c in task.constraints] == [(3.0,) * 12, solo12.velocity_limits]
    task = load_task_file(uneven, write(HEADING.replace(effort, speed)))
    env = LeggedEnv(solo12, task, 2, seed=0)
    violated = env.step(torch.zeros(2, 12)).violations["joint_velocity"]
    expected = env.state.joint_vel.abs() - torch.arange(1.0, 13.0)
    assert torch.allclose(violated, expected)


def test_a_task_of_ones_own_runs_without_touching_the_package(solo12, write):
    task = load_task_file(solo12, write(HEADING))
    assert (task.name, task.episode_s, task.command) == ("turn", 4.0, HeadingCommand(2.0))
    env = LeggedEnv(solo12, task, 4, seed=0)
    assert env.terms[-1].name == "heading_command"
    step = env.step(torch.zeros(4, 12))
    assert step.reward.shape == (4,)
    assert set(step.violations) == {"foot_force"}


def test_an_asked_heading_is_seen_from_the_base_and_pays_when_it_is_held(solo12, write):
    env = LeggedEnv(solo12, load_task_file(solo12, write(HEADING)), 2, seed=0)
    ahead = env.state.root_quat.new_tensor([[1.0, 0.0, 0.0]]).repeat(2, 1)
    seen = env.task.command.observe(env.command, env.state)
    assert torch.allclose(seen.norm(dim=-1), torch.ones(2), atol=1e-5)
    env.command = ahead
    env.state.root_quat = env.state.root_quat.new_tensor([[1.0, 0, 0, 0], [0.0, 0, 0, 1.0]])
    term = env.task.rewards[0]
    assert term(env).tolist() == pytest.approx([1.0, 0.0], abs=1e-6)


def test_a_height_to_hold_is_seen_and_pays(solo12, write):
    text = """
    command = { type = "height", height = [0.1, 0.1] }
    rewards = [{ name = "lift", weight = 1.0, length = 0.1 }]
    """
    env = LeggedEnv(solo12, load_task_file(solo12, write(text)), 3, seed=0)
    assert env.observe().shape == (3, 46 + 1)
    assert torch.allclose(env.observe()[:, -1], torch.full((3,), 0.1))
    env.step(torch.zeros(3, 12))
    expected = torch.exp(-(env.end_effector()[:, 2] - 0.1).abs() / 0.1)
    assert torch.allclose(env.task.rewards[0](env), expected)


def test_a_base_below_the_height_of_the_task_has_fallen(solo12, write):
    for height, fell in ((0.5, True), (0.05, False)):
        rewards = 'rewards = [{ name = "tilt", weight = -1.0 }]'
        task = load_task_file(solo12, write(f"fall_height = {height}\n{rewards}"))
        assert bool(LeggedEnv(solo12, task, 2, seed=0).step(torch.zeros(2, 12)).fell.all()) is fell


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ('"track_heading", weight', '"track_headin", weight', "rewards[0].name: 'track_headin'"),
        ("weight = 1.0, variance", "variance", "rewards[0].weight: missing; expected a number"),
        (", variance = 0.25", "", "rewards[0].variance: missing; expected a number"),
        ("variance = 0.25", "varience = 0.25", "rewards[0].varience: unknown key; did you mean"),
        ("weight = -0.1", 'weight = "a"', "rewards[1].weight: expected a number, found 'a'"),
        ('"tilt"', '"reach", sharpness = 1.0', "rewards[1].name: 'reach' needs a command of type"),
        ('type = "heading"', 'type = "hedding"', "command.type: expected one of velocity, target"),
        (
            "max_angle = 2.0",
            "max_angle = -2.0",
            "command.max_angle: expected an angle in radians, above 0 and",
        ),
        (
            "max_angle = 2.0",
            "max_angle = 90.0",
            "command.max_angle: expected an angle in radians, above 0 and",
        ),
        ("variance = 0.25", "variance = 0", "rewards[0].variance: expected a number above 0, fo"),
        ("episode_s = 4.0", "fall_height = 220", "fall_height: expected a length in metres, abo"),
        ("episode_s = 4.0", "reset = { heading = 180 }", "reset.heading: expected an angle in ra"),
        ('"foot_force"', '"foot_fors"', "constraints[0].name: 'foot_fors' is no constraint; did"),
        ('"foot_force"', '"action_rate"', "constraints[0].limit: missing; expected a number"),
        ('"foot_force"', '"air_time", limit = 1.0', "constraints[0].name: 'air_time' needs a com"),
        ("max_p = 0.1", "max_p = 2", "constraints[0].max_p: expected a number between 0 and 1"),
        ("episode_s = 4.0", "episode = 4.0", "episode: unknown key; did you mean 'episode_s'?"),
        ("episode_s = 4.0", 'action_scale = "run"', "action_scale: expected one of low, walk"),
        ("episode_s = 4.0", "reset = { joint_scale = [2, 1] }", "reset.joint_scale: expected two"),
        ("episode_s = 4.0", "randomisation = { push = -1 }", "randomisation.push: expected a nu"),
        ("episode_s = 4.0", "episode_s = inf", "episode_s: expected a finite number, found inf"),
        ("rewards = [", "rewards = [3,", "rewards[0]: expected a table, found 3"),
    ],
)
def test_every_mistake_names_the_file_and_the_key(solo12, write, old, new, words):
    assert old in HEADING
    path = write(HEADING.replace(old, new, 1))
    with pytest.raises(RobotError, match=re.escape(f"{path}: {words}")) as caught:
        load_task_file(solo12, path)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("text", ["", "rewards = []"])
def test_a_task_that_rewards_nothing_is_refused(solo12, write, text):
    with pytest.raises(RobotError, match="rewards: missing; expected at least one reward term"):
        load_task_file(solo12, write(text))


def test_a_task_that_the_robot_has_not_is_named(solo12, tmp_path):
    with pytest.raises(RobotError, match="has no task 'jump'; choose one of walk"):
        load_task(solo12, "jump")
    with pytest.raises(RobotError, match=r"gone\.toml: cannot be read"):
        load_task_file(solo12, tmp_path / "gone.toml")
