"""Moments worth learning from."""

from dataclasses import replace

import numpy as np
import pytest

from lacoloco.datasets.errors import DatasetError
from lacoloco.datasets.moments import MomentConfig, chosen


@pytest.fixture
def dog(make_clip):
    """Six seconds: it stands, trots at 0.5 m/s, and gallops at 2 m/s, two seconds each."""
    clip = make_clip(name="dog", frames=300, weight=2.0)
    velocity, turn = clip.root_lin_vel_b.copy(), np.zeros_like(clip.root_ang_vel_b)
    velocity[:] = 0.0
    velocity[100:200, 0], velocity[200:, 0] = 0.5, 2.0
    return replace(clip, root_lin_vel_b=velocity, root_ang_vel_b=turn)


def test_nothing_asked_for_changes_nothing(dog):
    assert chosen([dog], MomentConfig()) == [dog]


def test_standing_weighs_less_and_a_gallop_is_left_out(dog):
    stands, trots = chosen([dog], MomentConfig(max_speed=1.0, still_weight=0.25))
    assert (stands.weight, trots.weight) == (0.5, 2.0)
    assert (stands.name, trots.name) == ("dog@0.0s", "dog@1.8s")
    # Averaging moves each boundary by at most half of its window.
    assert stands.duration == pytest.approx(2.0, abs=0.27)
    assert np.linalg.norm(trots.root_lin_vel_b, axis=1)[13:-13] == pytest.approx(0.5)


def test_who_turns_on_the_spot_does_not_stand(dog):
    turning = replace(dog, root_ang_vel_b=np.tile([0.0, 0.0, 1.0], (300, 1)))
    (piece,) = chosen([turning], MomentConfig(max_speed=1.0, still_weight=0.25))
    assert (piece.name, piece.weight) == ("dog@0.0s", 2.0)


def test_a_stumble_is_too_short_to_be_a_piece(dog):
    velocity = dog.root_lin_vel_b.copy()
    velocity[:, 0] = 2.0
    velocity[100:115, 0] = 0.0
    with pytest.raises(DatasetError, match="max_speed = 1: none of 1 clips"):
        chosen([replace(dog, root_lin_vel_b=velocity)], MomentConfig(max_speed=1.0))


def test_without_a_limit_the_gallop_stays(dog):
    *_, gallops = chosen([dog], MomentConfig(still_weight=0.25))
    assert float(gallops.root_lin_vel_b[-1, 0]) == 2.0
