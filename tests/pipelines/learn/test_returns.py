"""GAE with soft terminations, against numbers worked out by hand."""

import pytest
import torch

from lacoloco.pipelines.learn.returns import advantages


def column(*values, dtype=torch.float32):
    return torch.tensor(values, dtype=dtype)[:, None]


def gae(rewards, values, next_values, delta, done, gamma=0.9, lam=0.8):
    result = advantages(
        column(*rewards),
        column(*values),
        column(*next_values),
        column(*delta),
        column(*done, dtype=torch.bool),
        gamma=gamma,
        lam=lam,
    )
    return result[:, 0].tolist()


def test_delta_discounts_value_and_trace():
    """With delta_1 = 0.2 the second step survives with 0.9 x 0.8 = 0.72.

    errors: 1 + 0.9 x 2 - 1 = 1.8, 0 + 0.72 x 3 - 2 = 0.16, 2 + 0.9 x 4 - 3 = 2.6;
    A_2 = 2.6, A_1 = 0.16 + 0.72 x 0.8 x 2.6 = 1.6576, A_0 = 1.8 + 0.9 x 0.8 x 1.6576 = 2.993472.
    """
    found = gae([1, 0, 2], [1, 2, 3], [2, 3, 4], [0, 0.2, 0], [0, 0, 0])
    assert found == pytest.approx([2.993472, 1.6576, 2.6], abs=1e-6)


def test_without_delta_it_is_plain_gae():
    found = gae([1, 0, 2], [1, 2, 3], [2, 3, 4], [0, 0, 0], [0, 0, 0])
    second = 0.7 + 0.72 * 2.6
    assert found == pytest.approx([1.8 + 0.72 * second, second, 2.6], abs=1e-6)


def test_a_time_out_bootstraps_and_a_fall_does_not():
    """Bug B3: the original takes the time-out for a death.

    Both cut the trace after step 0; the time-out's last state is worth 5, the fall's nothing.
    """
    common = {"rewards": [1, 7], "values": [1, 3], "delta": [0, 0], "done": [1, 0]}
    time_out = gae(next_values=[5, 4], **common)
    fall = gae(next_values=[0, 4], **common)
    assert time_out == pytest.approx([1 + 0.9 * 5 - 1, 7 + 0.9 * 4 - 3])
    assert fall == pytest.approx([1 + 0.0 - 1, 7 + 0.9 * 4 - 3])


def test_a_certain_termination_leaves_the_reward_alone():
    assert gae([1, 9], [2, 5], [5, 5], [1, 0], [0, 0])[0] == pytest.approx(1 - 2)


def test_with_lambda_one_it_is_the_discounted_sum():
    """A_0 + V_0 = sum_t prod_{k<t} gamma (1 - delta_k) r_t, the objective of the paper."""
    generator = torch.Generator().manual_seed(0)
    rewards, delta = torch.rand(6, generator=generator), torch.rand(6, generator=generator)
    values = torch.rand(7, generator=generator)
    found = gae(
        rewards.tolist(),
        values[:-1].tolist(),
        values[1:].tolist(),
        delta.tolist(),
        [0] * 6,
        lam=1.0,
    )
    expected, survive = 0.0, 1.0
    for step in range(6):
        expected += survive * float(rewards[step])
        survive *= 0.9 * (1 - float(delta[step]))
    expected += survive * float(values[-1])
    assert found[0] + float(values[0]) == pytest.approx(expected, rel=1e-5)


def test_worlds_do_not_mix():
    generator = torch.Generator().manual_seed(1)
    rewards, values, following, delta = torch.rand(4, 5, 3, generator=generator)
    done = torch.rand(5, 3, generator=generator) < 0.3
    options = {"gamma": 0.9, "lam": 0.8}
    both = advantages(rewards, values, following, delta, done, **options)
    for world in range(3):
        part = [each[:, [world]] for each in (rewards, values, following, delta, done)]
        assert torch.allclose(advantages(*part, **options), both[:, [world]], atol=1e-6)
