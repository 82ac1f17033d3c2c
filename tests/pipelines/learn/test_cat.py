"""Constraints as terminations: delta = max_i p_i clip(c_i+ / c_i^max, 0, 1)."""

import pytest
import torch

from lacoloco.pipelines.learn.cat import SoftTerminations, ramp, soft_terminations, terminated


def margins(*rows):
    return {"force": torch.tensor(rows, dtype=torch.float32)}


def test_the_example_of_the_paper():
    """c = [-1, 5, 10], c_max 10, p 0.2 -> [0, 0.1, 0.2]."""
    terminations = SoftTerminations({"force": 0.2}, rate=0.0)
    terminations(margins([10.0]), 1.0)
    delta = terminations(margins([-1.0], [5.0], [10.0]), 1.0)
    assert delta.tolist() == pytest.approx([0.0, 0.1, 0.2])


def test_every_column_has_its_own_scale_and_the_worst_column_counts():
    """Means of the violations: 8 in the first column, 2.5 in the second."""
    delta = SoftTerminations({"force": 0.5})(margins([4.0, 1.0], [12.0, -3.0], [0.0, 4.0]), 1.0)
    assert delta.tolist() == pytest.approx([0.25, 0.5, 0.5])


def test_one_that_crashes_does_not_make_the_others_cheap():
    """With the maximum of the batch, 200 N, the others' 2 N would be a hundredth of the worst."""
    delta = SoftTerminations({"force": 0.2})(margins(*[[2.0]] * 99, [200.0]), 1.0)
    assert delta[0] == pytest.approx(0.2 * 2.0 / 3.98)


def test_the_worst_constraint_counts_each_with_its_own_probability():
    terminations = SoftTerminations({"force": 0.2, "speed": 1.0})
    violations = margins([10.0], [5.0]) | {"speed": torch.tensor([[-1.0], [3.0]])}
    assert terminations(violations, 1.0).tolist() == pytest.approx([0.2, 1.0])


def test_the_scale_follows_the_mean_violation_with_rate_a_twentieth():
    terminations = SoftTerminations({"force": 0.2})
    terminations(margins([10.0]), 1.0)
    delta = terminations(margins([34.75], [5.25], [-8.0]), 1.0)
    assert terminations.c_max["force"].tolist() == pytest.approx([0.95 * 10 + 0.05 * 20])
    assert delta.tolist() == pytest.approx([0.2, 0.2 * 5.25 / 10.5, 0.0])


def test_quiet_steps_do_not_lower_the_scale():
    """The original's decays, so that after a while the slightest graze counts as the worst case."""
    terminations = SoftTerminations({"force": 0.2})
    terminations(margins([10.0]), 1.0)
    for _ in range(200):
        assert terminations(margins([-4.0]), 1.0).tolist() == [0.0]
    assert terminations(margins([1.0]), 1.0).tolist() == pytest.approx([0.2 / (0.95 * 10 + 0.05)])


def test_without_any_violation_yet_there_is_no_termination():
    delta = SoftTerminations({"force": 0.2})(margins([-1.0, 0.0], [-2.0, -5.0]), 1.0)
    assert delta.tolist() == [0.0, 0.0]


def test_strength_scales_every_probability():
    """Half-way up the ramp of the original, after 15 000 of 30 000 steps, p is 0.1 for Solo12."""
    strength = ramp(15_000 / 30_000, 0.0, 1.0)
    delta = SoftTerminations({"force": 0.2})(margins([10.0]), strength)
    assert delta.tolist() == pytest.approx([0.1])


@pytest.mark.parametrize(
    ("progress", "expected"), [(0.0, 0), (0.6, 0), (0.7, 0.5), (0.75, 0.75), (0.8, 1), (1.0, 1)]
)
def test_ramp_is_linear_between_its_ends(progress, expected):
    assert ramp(progress, 0.6, 0.8) == pytest.approx(expected)


def test_a_ramp_without_length_is_a_step():
    assert ramp(0.29, 0.3, 0.3) == 0.0
    assert ramp(0.3, 0.3, 0.3) == 1.0
    assert ramp(0.0, 0.0, 0.0) == 1.0


def test_the_share_of_violations_is_reported():
    terminations = SoftTerminations({"force": 0.2})
    terminations(margins([1.0, -1.0], [-1.0, -1.0]), 0.0)
    assert float(terminations.violated["force"]) == pytest.approx(0.25)


def test_state_dict_restores_the_scales():
    first, second = SoftTerminations({"force": 0.2}), SoftTerminations({"force": 0.2})
    first(margins([10.0]), 1.0)
    second.load_state_dict(first.state_dict())
    assert second(margins([4.0]), 1.0).tolist() == first(margins([4.0]), 1.0).tolist()


def test_a_violation_never_pays():
    """Half of what is earned is lost; a penalty stays whole, where half of it would be a gain."""
    reward, delta = torch.tensor([2.0, -2.0, 0.0, -2.0]), torch.tensor([0.5, 0.5, 0.5, 0.0])
    assert terminated(reward, delta).tolist() == [1.0, -2.0, 0.0, -2.0]
    assert (terminated(reward, torch.ones(4)) <= terminated(reward, torch.zeros(4))).all()


def test_by_the_papers_text_the_scale_is_the_largest_of_the_last_batch():
    terminations = soft_terminations({"force": 0.2}, "maximum")
    assert terminations(margins([4.0], [2.0]), 1.0).tolist() == pytest.approx([0.2, 0.1])
    assert terminations(margins([1.0], [8.0]), 1.0).tolist() == pytest.approx([0.025, 0.2])
    terminations.end_batch()
    restored = soft_terminations({"force": 0.2}, "maximum")
    restored.load_state_dict(terminations.state_dict())
    assert restored(margins([2.0], [40.0]), 1.0).tolist() == pytest.approx([0.05, 0.2])
    restored.end_batch()
    assert restored(margins([2.0], [40.0]), 1.0).tolist() == pytest.approx([0.01, 0.2])


def test_the_usual_scale_knows_no_batches():
    terminations = soft_terminations({"force": 0.2}, "mean")
    terminations(margins([10.0]), 1.0)
    terminations.end_batch()
    assert terminations.c_max["force"].tolist() == [10.0]
