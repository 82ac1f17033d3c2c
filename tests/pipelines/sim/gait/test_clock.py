"""The gait clock."""

import pytest
import torch

from lacoloco.pipelines.sim.gait.clock import GaitClock
from lacoloco.pipelines.sim.physics import CONTROL_DT

YES, NO = torch.tensor([True]), torch.tensor([False])
EQUAL = torch.tensor([[100.0, 100.0]])


@pytest.fixture
def clock(h1):
    return GaitClock(h1.gait, 1, torch.device("cpu"))


def advance(clock, asked, speed=0.0, tilt=0.0, force=EQUAL):
    clock.advance(asked, torch.tensor([speed]), torch.tensor([tilt]), force)


def test_it_rests_until_it_is_asked(clock):
    advance(clock, NO)
    assert not clock.stepping and clock.phase == 0.0
    assert not clock.swings().any() and not clock.observe().any()
    advance(clock, YES)
    assert clock.stepping


@pytest.mark.parametrize(
    ("asked", "force", "first"),
    [
        (YES, [[300.0, 100.0]], 0),
        (YES, [[100.0, 300.0]], 0),
        (NO, [[300.0, 100.0]], 1),
        (NO, [[100.0, 300.0]], 0),
    ],
)
def test_a_walk_starts_with_the_first_foot_and_a_rescue_with_the_unloaded_one(
    clock, asked, force, first
):
    advance(clock, asked, tilt=0.5, force=torch.tensor(force))
    while not clock.swings().any():
        advance(clock, asked)
    assert clock.swings()[0].tolist() == [first == 0, first == 1]


def test_a_cycle_swings_each_foot_for_its_share_and_never_both(clock):
    advance(clock, YES)
    swings = []
    for _ in range(10 * round(clock.gait.period / CONTROL_DT)):
        advance(clock, YES)
        swings.append(clock.swings()[0])
    shares = torch.stack(swings).float()
    assert shares.mean(dim=0).tolist() == pytest.approx([clock.gait.swing_share] * 2, abs=0.03)
    assert shares.sum(dim=1).max() == 1.0


def test_it_stops_a_cycle_later_with_both_feet_down_and_only_when_slow(clock):
    advance(clock, YES)
    cycle = round(clock.gait.period / CONTROL_DT)
    for _ in range(cycle):
        advance(clock, NO)
        assert clock.stepping
    for _ in range(2 * cycle):
        advance(clock, NO, speed=clock.gait.stop_speed + 0.01)
        assert clock.stepping
    for _ in range(cycle):
        advance(clock, NO)
    assert not clock.stepping
    assert clock.phase % 0.5 >= clock.gait.swing_share


@pytest.mark.parametrize("sign", ["speed", "tilt"])
def test_a_standing_robot_that_drifts_or_tilts_steps(clock, sign):
    advance(clock, NO, **{sign: getattr(clock.gait, f"start_{sign}") - 0.01})
    assert not clock.stepping
    advance(clock, NO, **{sign: getattr(clock.gait, f"start_{sign}") + 0.01})
    assert clock.stepping


def test_a_clock_goes_on_from_its_memory_as_it_would_have_gone_on_itself(clock):
    other = GaitClock(clock.gait, 1, torch.device("cpu"))
    asked = [YES] * 50 + [NO] * 100 + [YES] * 3 + [NO] * 60
    for step, now in enumerate(asked):
        other.reset(torch.arange(1), torch.full((1,), 0.77), torch.tensor([step % 2 == 0]))
        other.recall(clock.memory(), torch.tensor([True]))
        for each in (clock, other):
            advance(each, now)
        assert other.stepping == clock.stepping, step
        assert not clock.stepping or torch.allclose(other.phase, clock.phase, atol=1e-5), step


def test_only_the_clocks_of_the_mask_recall(h1):
    clock = GaitClock(h1.gait, 2, torch.device("cpu"))
    clock.reset(torch.arange(2), torch.full((2,), 0.9), torch.tensor([True, True]))
    memory = clock.memory()
    clock.reset(torch.arange(2), torch.full((2,), 0.1), torch.tensor([True, True]))
    clock.recall(memory, torch.tensor([True, False]))
    assert torch.allclose(clock.phase, torch.tensor([0.9, 0.1]), atol=1e-6)
