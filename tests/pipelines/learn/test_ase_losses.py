"""What else the actor of the adversarial learner minimises: diversity, and what experts say."""

import math
from types import SimpleNamespace

import pytest
import torch
from small_ase import fill


def test_diversity_by_hand(make_ase, monkeypatch):
    """(1 - |mu(z) - mu(z')|^2 / 2 / D_z)^2 with D_z = 0.5 (1 - z . z'), over the exploring rows of
    the first quarter.
    """
    ase = make_ase(diversity=0.01)
    z = torch.tensor([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]])
    other = torch.tensor([[0.0, 1.0, 0.0], [0.0, -1.0, 0.0], [0.0, 1.0, 0.0]])
    monkeypatch.setattr(torch, "randn_like", lambda tensor: 3.0 * other)
    mean, moved = torch.zeros(3, 2), torch.tensor([[1.0, 0.0], [1.0, 1.0], [9.0, 9.0]])
    ase.actor = lambda obs: moved if torch.equal(obs["latent"], other) else None
    explore = torch.tensor([[1.0], [1.0], [0.0]])
    groups = {"policy": torch.zeros(3, 5), "latent": z, "explore": explore}
    batch = SimpleNamespace(observations={name: rows.repeat(4, 1) for name, rows in groups.items()})
    mean = torch.cat((mean, torch.full((9, 2), 7.0)))
    # D_z is 0.5 and 1; mean squared moves are 0.5 and 1: both ratios are 1.
    losses = ase.auxiliary_losses(batch, mean)
    assert list(losses) == ["diversity"]
    assert float(losses["diversity"]) == pytest.approx(0.0, abs=1e-6)
    moved[1] = 0.0
    again = ase.auxiliary_losses(batch, mean)["diversity"]
    assert float(again) == pytest.approx(0.01 * 0.5, rel=1e-3)
    assert make_ase(diversity=0.0).auxiliary_losses(batch, mean) == {}


def test_distance_to_experts_by_hand(make_ase):
    """Weight times the sum of (mean - label)^2 / (2 std^2); what nobody knows counts nothing."""
    ase = make_ase(diversity=0.0, label_weight=2.0)
    assert ase.auxiliary_losses(None, None) == {}, "nobody was asked"
    std = torch.tensor([0.5, 1.0])
    ase.actor = lambda obs: torch.tensor([[1.0, 2.0], [3.0, 4.0]])
    ase.actor.distribution = SimpleNamespace(log_std_param=std.log())
    labels = torch.tensor([[1.0, 1.0], [2.0, math.nan]])
    ase.answers = lambda count: (None, labels)
    by_hand = 2.0 * 0.5 * ((0.0 + 1.0) + (4.0 + 0.0)) / 2
    assert float(ase.auxiliary_losses(None, None)["label"]) == pytest.approx(by_hand)


def test_a_policy_that_experts_answer_comes_nearer_to_them(make_ase):
    ase = make_ase(diversity=0.0, label_weight=10.0)
    wanted = torch.full((8, ase.storage.actions.shape[-1]), 0.3)
    distances = []
    for _ in range(40):
        observations = fill(ase)
        ase.answers = lambda count, seen=observations: (seen, wanted)
        ase.compute_returns(observations)
        distances.append(ase.update()["label"])
    assert distances[-1] < 0.5 * distances[0]
