"""Every task is played before anything is trained; what training would stumble over has a name."""

import re
from dataclasses import replace

import pytest

from lacoloco.pipelines.sim.robot_trial import DIVERGED, DOWN, HELD, UNUSABLE, trial_checks
from lacoloco.robots.errors import RobotError


@pytest.fixture
def walking(solo12):
    """Solo12 with nothing but its walk, changed."""

    def change(**changes):
        return replace(solo12, tasks={"walk": solo12.tasks["walk"] | changes})

    return change


def problems(spec):
    return {check.name: check.problem for check in trial_checks(spec) if not check.passed}


def test_solo12_gives_training_what_it_needs(solo12):
    checks = trial_checks(solo12)
    assert {check.name for check in checks} == {UNUSABLE, DIVERGED, DOWN, HELD}
    assert all(check.passed for check in checks)


def test_a_torque_limit_that_is_too_low_for_standing_is_found(walking):
    rows = [{"name": "base_tilt", "limit": 0.1, "max_p": 0.1}]
    rows += [{"name": "torque", "limit": 0.05, "max_p": 0.1}]
    found = problems(walking(constraints=rows))
    assert set(found) == {HELD}
    start = "robot.toml: tasks.walk.constraints[1]: torque is violated by standing still, by up to"
    assert start in found[HELD]


def test_episodes_that_begin_fallen_are_found(walking):
    found = problems(walking(fall_height=0.6))
    assert set(found) == {DOWN}
    assert "robot.toml: tasks.walk.reset: 100% of the episodes begin fallen" in found[DOWN]


def test_physics_that_cannot_bear_an_untrained_policy_is_found(walking):
    wild = replace(walking(), stiffness=(1e9,) * 12, training_effort_limits=(1e9,) * 12)
    found = problems(wild)
    assert "tasks.walk: the physics diverges" in found[DIVERGED]


def test_a_gait_without_its_numbers_is_refused_with_the_task(walking):
    line = "robot.toml: tasks.walk: robot 'solo12': a task with `gait` needs a table [gait]"
    with pytest.raises(RobotError, match=re.escape(line)):
        trial_checks(walking(gait=True))
