"""The memory of past transitions."""

import torch

from lacoloco.pipelines.learn.replay import ReplayBuffer


def numbered(start, stop):
    return torch.arange(float(start), float(stop))[:, None].repeat(1, 2)


def test_it_fills_up_and_then_keeps_its_capacity():
    buffer = ReplayBuffer(10, 2, seed=0)
    buffer.add(numbered(0, 4))
    assert buffer.size == 4
    buffer.add(numbered(4, 13))  # six fit, three overwrite
    assert buffer.size == 10
    kept = sorted(buffer.data[:, 0].tolist())
    assert len(set(kept)) == 10
    assert {10.0, 11.0, 12.0} <= set(kept)
    assert set(kept) <= set(numbered(0, 13)[:, 0].tolist())


def test_newcomers_overwrite_random_slots():
    """Not the oldest first: after many rounds some old ones are still there."""
    buffer = ReplayBuffer(100, 2, seed=0)
    buffer.add(numbered(0, 100))
    for index in range(4):
        buffer.add(numbered(1000 * (index + 1), 1000 * (index + 1) + 25))
    oldest = int((buffer.data[:, 0] < 100).sum())
    assert 15 < oldest < 50  # expected: 100 x 0.75^4 = 32
    slots = torch.nonzero(buffer.data[:, 0] >= 4000).flatten()
    assert int((slots.diff() > 1).sum()) > 5


def test_samples_come_from_what_is_in_it_only():
    buffer = ReplayBuffer(50, 2, seed=0)
    buffer.add(numbered(1, 6))
    drawn = buffer.sample(500)
    assert drawn.shape == (500, 2)
    assert set(drawn[:, 0].tolist()) == {1.0, 2.0, 3.0, 4.0, 5.0}


def test_state_dict_goes_on_with_the_same_draws():
    first, second = ReplayBuffer(20, 2, seed=0), ReplayBuffer(20, 2, seed=5)
    first.add(numbered(0, 15))
    state = first.state_dict()
    state = {
        key: value.clone() if torch.is_tensor(value) else value for key, value in state.items()
    }
    second.load_state_dict(state)
    for buffer in (first, second):
        buffer.add(numbered(100, 112))
    assert torch.equal(first.data, second.data)
    assert torch.equal(first.sample(9), second.sample(9))


def test_only_a_fair_sample_of_a_large_memory_travels(monkeypatch):
    monkeypatch.setattr("lacoloco.pipelines.learn.replay.STATE_BYTES", 10 * 2 * 4)
    first, second = ReplayBuffer(40, 2, seed=0), ReplayBuffer(40, 2, seed=0)
    first.add(numbered(0, 35))
    second.load_state_dict(first.state_dict())
    assert second.data[: second.size, 0].tolist() == [0, 4, 8, 12, 16, 20, 24, 28, 32]
    second.add(numbered(100, 131))
    assert second.size == 40


def test_a_smaller_memory_takes_what_fits():
    """More processes share the work than before."""
    first, second = ReplayBuffer(8, 2, seed=0), ReplayBuffer(4, 2, seed=0)
    first.add(numbered(0, 8))
    second.load_state_dict(first.state_dict())
    assert (second.size, second.data[:, 0].tolist()) == (4, [0.0, 1.0, 2.0, 3.0])
