"""Warnings: each at a training that has the fault, and none at one that has not."""

import pytest

from lacoloco.pipelines.training import diagnostics as diagnosis
from lacoloco.pipelines.training.diagnostics import WARM_UP, high_level_warnings, low_level_warnings

HEALTHY = {
    "agent_accuracy": 0.7,
    "demo_accuracy": 0.8,
    "imitation_reward": 0.6,
    "encoder_cosine": 0.6,
    "diversity": 0.4,
    "speed": 0.25,
    "coverage_walk": 0.5,
    "coverage_reach": 0.2,
    "coverage_stand": 0.3,
    "coverage_fall": 0.0,
    "coverage_speed": 0.2,
    "coverage_cells": 0.8,
    "coverage_turn_left": 0.06,
    "coverage_turn_right": 0.05,
    "clips_cells": 0.95,
    "clips_turn_left": 0.1,
    "clips_turn_right": 0.1,
    "clips_walk": 0.77,
    "clips_reach": 0.09,
    "clips_stand": 0.14,
    "clips_speed": 0.27,
}
STEERED = {"latent_resultant": 0.4, "latent_directions": 4.0, "speed": 0.12}


def training(**changes):
    return [HEALTHY | changes] * WARM_UP


def names(warnings):
    return [line.partition(":")[0] for line in warnings]


@pytest.mark.parametrize(
    ("changes", "name"),
    [
        ({"agent_accuracy": 0.97, "demo_accuracy": 0.96}, "discriminator saturated"),
        ({"imitation_reward": 0.03}, "discriminator saturated"),
        ({"encoder_cosine": 0.02}, "latents ignored"),
        ({"coverage_walk": 0.97, "coverage_stand": 0.03, "coverage_reach": 0.0}, "mode collapse"),
        ({"coverage_fall": 0.99, "coverage_stand": 0.0, "coverage_walk": 0.01}, "mode collapse"),
        ({"coverage_stand": 0.95, "coverage_walk": 0.05}, "policy just stands"),
        ({"speed": 0.3, "coverage_speed": 0.01}, "reward hacked by resets"),
        ({"coverage_cells": 0.5}, "skills lost"),
        ({"coverage_turn_left": 0.01}, "hardly turns left"),
        ({"coverage_turn_right": 0.0}, "hardly turns right"),
    ],
)
def test_each_fault_is_named(changes, name):
    assert names(low_level_warnings(training(**changes))) == [name]


def test_a_healthy_training_is_not_warned_about():
    assert low_level_warnings(training()) == []
    assert high_level_warnings([STEERED] * WARM_UP, 0.15) == []


def test_clips_that_walk_only_do_not_collapse_and_clips_that_stand_may_be_stood():
    walk = {"coverage_walk": 1.0, "coverage_stand": 0.0, "coverage_reach": 0.0}
    assert (
        low_level_warnings(training(**walk, clips_walk=1.0, clips_reach=0.0, clips_stand=0.0)) == []
    )
    assert low_level_warnings(training(coverage_stand=0.95, clips_stand=0.9)) == []


def test_clips_that_turn_to_one_side_need_not_be_turned_to_the_other():
    assert low_level_warnings(training(clips_turn_left=0.01, coverage_turn_left=0.0)) == []


@pytest.mark.parametrize(
    ("changes", "name"),
    [({"latent_resultant": 0.98}, "mode collapse"), ({"speed": 0.01}, "policy just stands")],
)
def test_faults_of_a_high_level(changes, name):
    assert names(high_level_warnings([STEERED | changes] * WARM_UP, 0.15)) == [name]


def test_standing_is_no_fault_where_the_task_can_be_done_standing():
    still = [STEERED | {"speed": 0.0}] * WARM_UP
    assert high_level_warnings(still, 0.0) == []
    assert names(high_level_warnings([STEERED | {"speed": 0.05}] * WARM_UP, 0.5)) == [
        "policy just stands"
    ], "a larger robot walks faster"


def test_nothing_is_said_of_a_training_that_has_just_begun():
    assert low_level_warnings(training(encoder_cosine=0.0)[1:]) == []


def test_one_bad_iteration_is_not_a_fault_and_an_old_fault_is_over():
    bad = HEALTHY | {"agent_accuracy": 1.0, "demo_accuracy": 1.0}
    assert low_level_warnings([*training(), bad]) == []
    assert low_level_warnings([bad] * WARM_UP + training()) == []


def test_coverage_is_the_newest_there_is():
    rest = {name: value for name, value in HEALTHY.items() if not name.startswith(("cov", "clips"))}
    stands = HEALTHY | {"coverage_stand": 1.0, "coverage_walk": 0.0}
    assert names(low_level_warnings([HEALTHY] * WARM_UP + [stands, rest, rest])) == [
        "policy just stands"
    ]
    assert low_level_warnings([stands] * WARM_UP + [HEALTHY, rest]) == []


def test_figures_that_are_not_there_raise_no_warning():
    assert low_level_warnings([{"samples": 1.0}] * WARM_UP) == []


def test_every_line_says_what_to_try():
    faulty = training(encoder_cosine=0.0, coverage_stand=1.0, imitation_reward=0.0)
    assert len(low_level_warnings(faulty)) == 3
    assert all("; try " in line for line in low_level_warnings(faulty))
    assert "0.00" in diagnosis.latents_ignored(faulty)
