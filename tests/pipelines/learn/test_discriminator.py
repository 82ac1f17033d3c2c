"""What both discriminators share: normaliser, classification, imitation reward."""

import math

import pytest
import torch

from lacoloco.pipelines.learn.discriminator import (
    CLIP,
    TransitionNormalizer,
    classification,
    imitation_reward,
)


def test_undecided_pays_ln_two():
    """D = 0.5 gives -log(1 - 0.5); the original doubles it and halves it again."""
    assert float(imitation_reward(torch.zeros(1))) == pytest.approx(math.log(2.0))


def test_reward_is_minus_log_of_one_minus_d_up_to_its_ceiling():
    logits = torch.linspace(-8.0, 4.0, 25)
    expected = -torch.log(1.0 - torch.sigmoid(logits.double()))
    assert torch.allclose(imitation_reward(logits), expected.float(), atol=1e-5)
    assert imitation_reward(torch.tensor([5.1, 100.0, 1e30]), ceiling=5.0).tolist() == [5.0] * 3
    assert float(imitation_reward(torch.tensor([-1e30]))) == 0.0


def test_classification_by_hand():
    agent, demo = torch.tensor([0.0, math.log(3.0)]), torch.tensor([math.log(3.0)])
    loss, metrics = classification(agent, demo)
    # -log(1 - D) is ln 2 and ln 4; -log D is ln(4 / 3).
    expected = 0.5 * (0.5 * (math.log(2) + math.log(4)) + math.log(4 / 3))
    assert float(loss) == pytest.approx(expected, rel=1e-5)
    assert float(metrics["agent_accuracy"]) == 0.0
    assert float(metrics["demo_accuracy"]) == 1.0
    assert float(metrics["agent_logit"]) == pytest.approx(math.log(3.0) / 2)
    assert float(metrics["margin"]) == pytest.approx(math.log(3.0) / 2)


def test_accuracy_counts_each_class_on_its_own_side():
    _, metrics = classification(torch.tensor([-1.0, -2.0, 3.0, -4.0]), torch.tensor([1.0, -1.0]))
    assert float(metrics["agent_accuracy"]) == 0.75
    assert float(metrics["demo_accuracy"]) == 0.5


def test_both_frames_share_one_set_of_statistics():
    """So their difference keeps its meaning: it is scaled, and nothing else."""
    generator = torch.Generator().manual_seed(0)
    before = torch.randn(4000, 2, generator=generator) * torch.tensor([1.0, 3.0])
    after = before + torch.tensor([0.1, -0.3])
    transitions = torch.cat([before, after], dim=1)
    normalizer = TransitionNormalizer(2)
    normalizer.update(transitions[:2000], transitions[2000:])
    result = normalizer(transitions[:100])
    scale = normalizer.statistics.std + normalizer.statistics.eps
    assert torch.allclose(scale, torch.tensor([1.0, 3.0]), rtol=0.05)
    unclipped = (result.abs() < CLIP).all(dim=1)
    change = (result[:, 2:] - result[:, :2]) * scale
    assert torch.allclose(change[unclipped], (after - before)[:100][unclipped], atol=1e-5)


def test_statistics_are_taken_from_both_sides_in_equal_parts():
    """However many transitions there are of each: agent at 0, demonstrations at 1."""
    normalizer = TransitionNormalizer(1)
    normalizer.update(torch.zeros(10, 2), torch.ones(500, 2))
    assert normalizer.statistics.mean.tolist() == pytest.approx([0.5])
    assert normalizer.statistics.std.tolist() == pytest.approx([0.5])


def test_normalizer_by_hand():
    normalizer = TransitionNormalizer(2)
    normalizer.update(torch.tensor([[0.0, 7.0, 4.0, 7.0]]), torch.tensor([[4.0, 7.0, 0.0, 7.0]]))
    eps = normalizer.statistics.eps
    found = normalizer(torch.tensor([[4.0, 7.0, 0.0, 7.0 + eps]]))
    # Mean 2, std 2; a column that never varies is not blown up without bounds.
    expected = torch.tensor([[2 / (2 + eps), 0.0, -2 / (2 + eps), 1.0]])
    assert torch.allclose(found, expected, atol=1e-4)
    assert normalizer(torch.full((1, 4), 1e6)).tolist() == [[CLIP] * 4]


def test_normalizer_is_part_of_the_state():
    first, second = TransitionNormalizer(3), TransitionNormalizer(3)
    first.update(torch.randn(50, 6), torch.randn(50, 6) + 1.0)
    second.load_state_dict(first.state_dict())
    more, sample = torch.randn(20, 6), torch.randn(4, 6)
    for normalizer in (first, second):
        normalizer.update(more, more)
    assert torch.equal(first(sample), second(sample))
