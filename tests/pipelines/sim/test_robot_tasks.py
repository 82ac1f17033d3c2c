"""The tasks that a robot has to bring are all there, each with the command that its stage reads."""

import re
from dataclasses import replace

import pytest

from lacoloco.pipelines.sim.robot_tasks import NEEDED, check_tasks
from lacoloco.robots.errors import RobotError


def test_the_robots_bring_every_task(robot):
    check_tasks(robot)
    assert set(NEEDED) <= set(robot.tasks)


@pytest.mark.parametrize("name", NEEDED)
def test_a_task_that_a_stage_needs_is_asked_for_by_name(solo12, name):
    tasks = {key: task for key, task in solo12.tasks.items() if key != name}
    line = f"robot.toml: tasks.{name}: missing; expected a table, the task of {NEEDED[name].stage}"
    with pytest.raises(RobotError, match=re.escape(line)):
        check_tasks(replace(solo12, tasks=tasks))


@pytest.mark.parametrize(
    ("name", "change", "line"),
    [
        ("walk", {"command": {"type": "height", "height": [0.1, 0.2]}}, "walk.rewards[0].name: "),
        ("reach", {"rewards": []}, "reach.rewards: missing; expected at least one reward term"),
        (
            "reach",
            {"rewards": [], "command": {"type": "heading"}},
            "reach.command: expected a comm",
        ),
        (
            "imitate",
            {"command": {"type": "heading"}},
            "imitate.command: expected no command for tr",
        ),
        ("mine", {"episode": 2.0}, "mine.episode: unknown key; did you mean 'episode_s'?"),
    ],
)
def test_a_task_that_its_stage_cannot_train_on_is_refused(solo12, name, change, line):
    tasks = {**solo12.tasks, name: {**solo12.tasks.get(name, {}), **change}}
    with pytest.raises(RobotError, match=re.escape(f"robot.toml: tasks.{line}")) as caught:
        check_tasks(replace(solo12, tasks=tasks))
    assert "\n" not in str(caught.value)
