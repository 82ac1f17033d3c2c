"""Which worlds act on their mean, sample or dare more, and for how long."""

from __future__ import annotations

import math

import pytest
import torch

from lacoloco.pipelines.learn.exploration import HIGH_NOISE, Exploration, sampling_probability


def test_nine_steps_of_ten_explore():
    """Mean 0.900 over 4096 worlds, from always to never."""
    probability = sampling_probability(4096, 0.1)
    assert float(probability.mean()) == pytest.approx(0.9, abs=1e-3)
    assert float(probability[0]) == pytest.approx(1.0, abs=1e-4)
    assert float(probability[-1]) == 0.0
    assert (probability.diff() <= 0).all()
    # p_i = 1 - exp(10 (i / (N - 1) - 1)), the original's formula.
    assert float(probability[2047]) == pytest.approx(1 - math.exp(10 * (2047 / 4095 - 1)), rel=1e-5)


def test_every_step_explores_unless_asked_otherwise():
    assert sampling_probability(7, 0.0).tolist() == [1.0] * 7
    assert Exploration(7, 0.0, 1.0, 0.0, "cpu").advance().tolist() == [1.0] * 7


def seen(exploration: Exploration, steps: int = 4000) -> torch.Tensor:
    """(steps, N) factors, after the first hundred."""
    torch.manual_seed(0)
    return torch.stack([exploration.advance() for _ in range(steps)])[100:]


def test_worlds_explore_in_spells():
    """On average a new decision every 10 steps, by the same odds as ever."""
    exploration = Exploration(4, 0.5, 10.0, 0.0, "cpu")
    exploration.probability = torch.tensor([1.0, 0.0, 0.5, 0.5])
    factors = seen(exploration)
    assert (factors[:, 0] == 1.0).all()
    assert not factors[:, 1].any()
    assert factors[:, 2:].mean() == pytest.approx(0.5, abs=0.05)
    changes = factors[1:, 2:] != factors[:-1, 2:]
    assert float(changes.float().mean()) == pytest.approx(0.05, abs=0.01), (
        "half of the decisions change nothing"
    )


def test_some_of_the_sampling_spells_are_bold():
    exploration = Exploration(4, 0.5, 10.0, 0.25, "cpu")
    exploration.probability = torch.tensor([1.0, 0.0, 1.0, 1.0])
    exploration.high_noise_scale = 4.0
    factors = seen(exploration)
    assert set(factors.unique().tolist()) == {0.0, 1.0, 4.0}
    assert not factors[:, 1].any(), "the mean never has a larger noise scale"
    assert float((factors[:, [0, 2, 3]] == 4.0).float().mean()) == pytest.approx(0.25, abs=0.05)


def test_the_noise_scale_counts_at_once():
    exploration = Exploration(3, 0.0, 1e9, 0.0, "cpu")
    exploration.kind[1] = HIGH_NOISE
    exploration.high_noise_scale = 2.5
    assert exploration.advance().tolist() == [1.0, 2.5, 1.0]
