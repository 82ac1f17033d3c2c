"""How good an expert is."""

import pytest
import torch

from lacoloco.pipelines.generation.assessment import assess, assessed

EPISODES = {"worlds": 4, "seconds": 0.5, "transient_s": 0.1, "seed": 0, "device": "cpu"}


def held(joints, value=0.0):
    """A policy that always asks for the same."""
    return lambda observation: torch.full((len(observation), joints), value)


def test_who_holds_the_default_pose_stands_and_misses_its_command(solo12):
    found = assess(solo12, "walk", held(12), **EPISODES)
    assert found["walk_falls_pct"] == 0.0
    # Commands are uniform in +-0.5 m/s and +-0.78 rad/s; the robot hardly moves.
    assert 0.2 < found["walk_velocity_error"] < 0.6
    assert 0.1 < found["walk_yaw_error"] < 0.7


def test_who_folds_falls(solo12):
    found = assess(solo12, "walk", held(12, -20.0), **{**EPISODES, "seconds": 1.5})
    assert found["walk_falls_pct"] == 100.0


def test_a_target_is_measured_when_its_time_ends(h1):
    none_ended = assess(h1, "reach_in_place", held(19), **EPISODES)
    assert none_ended["reach_target_error"] is None
    found = assess(h1, "reach_in_place", held(19), **{**EPISODES, "worlds": 8, "seconds": 3.0})
    assert found["reach_target_error"] is None or found["reach_target_error"] > 0.0
    assert found["reach_falls_pct"] == pytest.approx(found["reach_falls_pct"])


def test_only_what_was_assessed_is_taken_from_an_artifact():
    metrics = {"walk_seconds": 3.0, "walk_falls_pct": 0.5, "walk_yaw_error": 0.1}
    assert assessed(metrics) == {"walk_falls_pct": 0.5, "walk_yaw_error": 0.1}
