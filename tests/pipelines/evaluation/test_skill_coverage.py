"""Skill coverage: what counts as a skill, and that counting leaves no trace."""

from dataclasses import replace

import pytest
import torch

from lacoloco.pipelines.evaluation.skill_coverage import Behaviour, SkillCoverage, clip_behaviour
from lacoloco.pipelines.learn.networks import NetworkConfig, make_actor
from lacoloco.pipelines.low_level.trainer import LowTrainer
from lacoloco.pipelines.policies import Head, Policy
from lacoloco.pipelines.train_low import smoke
from lacoloco.robots.numbers import SkillThresholds

THRESHOLDS = SkillThresholds(walk_speed=0.15, reach_height=0.15, not_reached=0.3, no_progress=0.4)


@pytest.fixture
def still():
    """A policy that stays in the default pose, whatever the latent."""
    sizes, networks = {"policy": 46, "latent": 7}, NetworkConfig(actor=(8,))
    actor = make_actor(sizes, 12, networks).eval()
    with torch.no_grad():
        actor.mlp[-1].weight.zero_()
    return Policy(Head("low", sizes, 12, networks, [], "imitate"), actor)


@pytest.fixture
def coverage(solo12, motions):
    return SkillCoverage(solo12, motions, latents=8, seconds=1.0)


def test_behaviours_are_counted_once_each_and_a_fall_first():
    metrics = Behaviour(
        speed=torch.tensor([0.0, 0.3, 0.3, 0.3, 0.1]),
        lift=torch.tensor([0.0, 0.0, 0.2, 0.2, 0.2]),
        frame=torch.zeros(5, 34),
        fell=torch.tensor([False, False, False, True, False]),
        thresholds=THRESHOLDS,
    ).shares()
    assert metrics == pytest.approx({"walk": 0.2, "reach": 0.4, "fall": 0.2, "stand": 0.2})


def test_quantiles_by_hand():
    """Of those that do not fall: one that tumbles at 9 m/s says nothing about walking."""
    speed = torch.cat((torch.linspace(0.0, 1.0, 11), torch.tensor([9.0])))
    metrics = Behaviour(speed, -speed, torch.zeros(12, 34), speed > 2.0, THRESHOLDS).distribution()
    assert metrics["speed"] == pytest.approx(0.5)
    quantiles = [metrics[f"speed_{name}"] for name in ("p10", "p50", "p90")]
    assert quantiles == pytest.approx([0.1, 0.5, 0.9])
    assert metrics["lift_p10"] == pytest.approx(-0.9)
    none = Behaviour(speed, -speed, torch.zeros(12, 34), speed > -1.0, THRESHOLDS).distribution()
    assert set(none.values()) == {0.0}


def test_a_policy_that_stands_still_is_said_to_stand(coverage, still):
    metrics = coverage.measure(still)
    assert metrics["coverage_stand"] == 1.0
    assert metrics["coverage_speed_p90"] < 0.05
    assert abs(metrics["coverage_lift"]) < 0.02
    assert metrics["coverage_clips"] == 0.0
    assert metrics["coverage_spread"] == pytest.approx(0.0, abs=1e-4)


def test_clips_are_counted_by_the_same_rules(coverage, solo12, motions):
    """They trot at 0.4 m/s, at the height at which the robot stands."""
    assert coverage.clips["clips_walk"] == 1.0
    assert coverage.clips["clips_speed_p50"] == pytest.approx(0.4, abs=0.01)
    higher = clip_behaviour(solo12, motions, 0.2, standing_height=-0.4, seed=0)
    assert higher.shares()["reach"] == 1.0


def test_a_policy_that_does_what_the_clips_do_reproduces_them(
    coverage, motions, monkeypatch, still
):
    """Latents whose mean style frames are the clips'; then some that went a third of the way."""
    standing, clips = coverage._standing_frame, coverage._clip_frames
    done = coverage._hold(still)
    for share, expected in ((1.0, 1.0), (0.6, 1.0), (0.3, 0.0)):
        frame = (standing + share * (clips - standing)).repeat(4, 1)
        monkeypatch.setattr(coverage, "_hold", lambda _, f=frame: replace(done, frame=f))
        assert coverage.measure(still)["coverage_clips"] == expected


def test_cells_are_measured_in_the_same_worlds(coverage, still):
    """The clips trot and turn left; a robot that stands does neither."""
    metrics = coverage.measure(still)
    assert metrics["coverage_cells"] == 0.0
    assert (metrics["clips_turn_left"], metrics["clips_turn_right"]) == (1.0, 0.0)
    assert (metrics["coverage_turn_left"], metrics["coverage_turn_right"]) == (0.0, 0.0)
    found = coverage.cells(still)
    assert found.metrics()["coverage_cells"] == 0.0
    torch.testing.assert_close(found.latents, torch.zeros(8, 4), atol=0.05, rtol=0.0)
    expected = torch.tensor([0.4, 0.0, 0.5]).expand(512, 3)
    torch.testing.assert_close(found.clips[:, :3], expected, atol=0.01, rtol=0.0)
    assert replace(found, latents=found.clips).metrics()["coverage_cells"] == 1.0
    assert not coverage.env.task.training_limits, "the motors of an evaluation"


def test_measuring_twice_gives_the_same(coverage, still):
    torch.manual_seed(0)
    with torch.no_grad():
        still.actor.mlp[-1].weight.normal_(std=0.02)
    first = coverage.measure(still)
    assert first["coverage_speed"] > 0.0
    torch.manual_seed(5)
    assert coverage.measure(still) == first
    assert int(coverage.env.steps.max()) == 50, "each begins where the first began"


def test_a_measured_training_is_the_one_it_would_have_been(solo12, motions):
    """Weights, worlds and generators, to the last bit."""
    outcomes = []
    for every in (0, 1):
        config = replace(smoke(), samples=128 * 2, coverage_every=every, coverage_latents=2)
        trainer = LowTrainer(solo12, motions, config, seed=0, device="cpu")
        metrics = [trainer.iterate(step / 2) for step in range(2)]
        outcomes.append((metrics, trainer.algorithm.actor.state_dict(), torch.get_rng_state()))
    (plain, weights, draw), (measured, same_weights, same_draw) = outcomes
    assert all(torch.equal(weights[name], same_weights[name]) for name in weights)
    assert torch.equal(draw, same_draw)
    assert ["coverage_walk" in metrics for metrics in plain] == [False, True]
    assert ["coverage_walk" in metrics for metrics in measured] == [True] * 2
    assert {k: v for k, v in measured[0].items() if k in plain[0]} == plain[0]


def test_coverage_is_measured_when_its_samples_are_full_and_at_the_end(solo12, motions):
    config = replace(smoke(), samples=128 * 5, coverage_every=250)
    trainer = LowTrainer(solo12, motions, config, seed=0, device="cpu")
    trainer.selection.measure = lambda actor: {"coverage_walk": 0.5}
    trainer.selection.examine = lambda actor, samples: {"coverage_walk": 0.5, "score": 0.0}
    trainer.selection.confirm = trainer.selection.measure
    seen = ["coverage_walk" in trainer.iterate(step / 5) for step in range(5)]
    assert seen == [False, True, False, True, True], "after 256, 512 and all 640 samples"
