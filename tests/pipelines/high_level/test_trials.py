"""Held latents, and what came of them."""

import pytest
import torch

from lacoloco.datasets.rotations import from_yaw
from lacoloco.pipelines.high_level.trials import OFFSETS, _held_until, summarised

STEPS = OFFSETS[-1] + 4


@pytest.fixture
def series():
    """Two robots that look to the left; the hand goes 0.1 m to the left a decision. The second
    falls at decision 5.
    """
    along = 0.1 * torch.arange(STEPS)[:, None].expand(STEPS, 2)
    base = torch.tensor([3.0, -2.0, 0.9]).expand(STEPS, 2, 3)
    nothing = torch.zeros(STEPS, 2)
    fell = torch.zeros(STEPS, 2, dtype=torch.bool)
    fell[5, 1] = True
    ends = fell.clone()
    ends[-1] = True
    return {
        "obs": torch.arange(STEPS * 2.0).view(STEPS, 2, 1),
        "latent": torch.ones(STEPS, 2, 1),
        "end_effector": base + torch.stack((nothing, along, nothing), dim=-1),
        "root_pos": base,
        "root_quat": from_yaw(torch.full((STEPS, 2), torch.pi / 2)),
        "ends": ends,
        "fell": fell,
        "tried": torch.ones(STEPS, 2, dtype=torch.bool),
    }


def row_of(trials, decision, world):
    return int((trials.obs[:, 0] == 2 * decision + world).nonzero())


def test_the_end_effector_is_followed_in_the_base_frame_of_the_decision(series):
    trials = summarised(series)
    row = row_of(trials, 3, 0)
    expected = [0.1 * (3 + offset) for offset in OFFSETS]
    assert trials.standing[row].all()
    assert not trials.fell[row].any()
    assert trials.reached[row, :, 0].tolist() == pytest.approx(expected, abs=1e-5)
    assert trials.reached[row, :, 1:].abs().max() < 1e-5
    ahead = trials.ahead(torch.tensor([row]))[0]
    assert ahead.tolist() == pytest.approx([expected[-1], 0.0], abs=1e-5)


def test_a_fall_is_known_from_when_on_and_nothing_after_it_counts(series):
    trials = summarised(series)
    row = row_of(trials, 1, 1)
    assert trials.standing[row].tolist() == [1 + offset <= 5 for offset in OFFSETS]
    assert trials.fell[row].tolist() == [1 + offset > 5 for offset in OFFSETS]


def test_what_another_latent_did_is_not_known(series):
    series["ends"][7, 0] = True
    trials = summarised(series)
    row = row_of(trials, 2, 0)
    assert trials.standing[row].tolist() == [2 + offset <= 7 for offset in OFFSETS]
    assert not trials.fell[row].any()
    assert not (trials.obs[:, 0] == 2 * 7).any(), "nothing is known of it"


def test_only_random_latents_count(series):
    series["tried"][:, 0] = False
    assert (summarised(series).obs[:, 0] % 2 == 1).all()


def test_both_trials_are_kept(series):
    trials = summarised(series)
    both = trials.joined(trials)
    assert len(both.obs) == 2 * len(trials.obs)
    assert torch.equal(both.fell[: len(trials.fell)], both.fell[len(trials.fell) :])


def test_a_latent_ends_with_its_hold_or_its_episode():
    ends = torch.tensor([[0, 1, 0, 0, 1, 0, 0]], dtype=torch.bool).T
    assert _held_until(ends).flatten().tolist() == [1, 1, 4, 4, 4, 6, 6]
