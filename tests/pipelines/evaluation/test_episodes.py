"""Episodes: how the measures of Table I are counted."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from lacoloco.pipelines.evaluation import episodes
from lacoloco.pipelines.evaluation.episodes import Episodes, play_episodes
from lacoloco.pipelines.learn.networks import NetworkConfig, make_actor
from lacoloco.pipelines.policies import Head, Policy
from lacoloco.pipelines.sim.hierarchical_env import Decision
from lacoloco.pipelines.sim.tasks import load_task
from lacoloco.robots.registry import load_robot

THRESHOLDS = load_robot("solo12").skills


@pytest.fixture
def policies():
    def policy(role, sizes, actions):
        torch.manual_seed(0)
        actor = make_actor(sizes, actions, NetworkConfig(actor=(16,))).eval()
        return Policy(Head(role, sizes, actions, NetworkConfig(actor=(16,)), [], "reach"), actor)

    return {
        "low": policy("low", {"policy": 46, "latent": 7}, 12),
        "high": policy("high", {"policy": 44}, 7),
    }


@pytest.fixture
def short(monkeypatch):
    """Episodes of four decisions."""
    monkeypatch.setattr(
        episodes, "load_task", lambda spec, name: replace(load_task(spec, name), episode_s=0.4)
    )


def test_an_episode_that_diverged_is_a_fall_and_no_error():
    nothing = np.zeros(4)
    played = Episodes(
        error=np.array([0.1, np.nan, 0.3, 7.0]),
        fell=np.array([False, True, False, True]),
        above_limit=np.zeros((4, 4)),
        substeps=np.full(4, 20.0),
        samples=nothing,
        samples_above=np.zeros((4, 4)),
        samples_any=nothing,
        thresholds=THRESHOLDS,
        diverged=np.array([False, False, False, True]),
    )
    assert played.diverged.tolist() == [False, True, False, True]
    metrics = played.metrics()
    assert metrics["ee_error_mean_m"] == pytest.approx(0.2)
    assert metrics["ee_error_std_m"] == pytest.approx(0.1)
    assert metrics["ee_error_median_m"] == pytest.approx(0.2)
    assert metrics["falls_pct"] == 50.0
    low, high = played.intervals()["ee_error_mean_m"]
    assert 0.1 - 1e-9 <= low <= high <= 0.3 + 1e-9


def test_metrics_by_hand():
    played = Episodes(
        error=np.array([0.01, 0.35, 0.03, 0.41]),
        fell=np.array([True, True, False, False]),
        above_limit=np.array([[3.0, 0.0], [0.0, 1.0], [0.0, 0.0], [0.0, 0.0]]),
        substeps=np.array([20.0, 80.0, 50.0, 50.0]),
        samples=np.array([1.0, 4.0, 2.0, 3.0]),
        samples_above=np.array([[1.0, 1.0], [1.0, 0.0], [0.0, 0.0], [0.0, 0.0]]),
        samples_any=np.array([1.0, 1.0, 0.0, 0.0]),
        thresholds=THRESHOLDS,
    )
    metrics = played.metrics()
    assert metrics == pytest.approx(
        {
            "ee_error_mean_m": 0.2,
            "ee_error_std_m": 0.0329**0.5,
            "ee_error_median_m": 0.19,
            "contact_violation_pct": 1.0,  # 4 of 200 substeps x 2 feet
            "contact_violation_original_pct": 15.0,  # 3 of 10 looks x 2 feet
            "contact_violation_original_any_foot_pct": 20.0,  # 2 of 10 looks
            "falls_pct": 50.0,
            "not_reached_pct": 25.0,  # a fall far away is a fall
            "success_5cm_pct": 25.0,  # nor is a fall near the target a success
            "success_30cm_pct": 25.0,
        }
    )


def test_who_missed_and_never_came_nearer():
    """Somebody who touched, one who fell where it began, one who stayed, one who came half of the
    way.
    """
    played = Episodes(
        error=np.array([0.01, 1.5, 1.4, 0.8]),
        fell=np.array([False, True, False, False]),
        above_limit=np.zeros((4, 2)),
        substeps=np.ones(4),
        samples=np.ones(4),
        samples_above=np.zeros((4, 2)),
        samples_any=np.zeros(4),
        thresholds=THRESHOLDS,
        parameters={"target_distance_m": np.array([0.3, 1.5, 1.6, 1.5])},
    )
    assert played.not_reached.tolist() == [False, False, True, True]
    assert played.no_progress.tolist() == [False, False, True, False]


def test_an_episode_counts_until_it_ends_and_never_after(solo12, policies, short, monkeypatch):
    """Bug B15: the original's last row is the state after the reset, and fallen worlds start anew.

    World 0 falls in its second decision, world 1 lives for all four.
    """
    count = iter(range(1, 5))

    class Scripted:
        def __init__(self, env, low, latent_dim):
            self.latent, self.device = torch.zeros(2, latent_dim), torch.device("cpu")

        def observe(self):
            return torch.zeros(2, 44)

        def step(self, z):
            decision = next(count)
            fell = torch.tensor([decision == 2, False])
            timed_out = torch.tensor([False, decision == 4])
            error, each = torch.tensor([1.0, 2.0]) / decision, torch.full((2,), 20.0)
            sampled = torch.tensor([decision < 2, True])
            above = torch.tensor([[True, False, False, True]]) & sampled[:, None]
            limits, lost = torch.ones(2, 4), torch.tensor([decision >= 2, decision > 4])
            return Decision(each, fell, timed_out, error, limits, each, sampled, above, lost)

    monkeypatch.setattr(episodes, "steered", lambda env, policies: Scripted(env, None, 7))
    played = play_episodes(solo12, policies, 2, worlds=2, seed=0)
    assert played.error.tolist() == [0.5, 0.5]
    assert played.fell.tolist() == [True, False]
    assert played.diverged.tolist() == [True, False]
    assert played.substeps.tolist() == [40.0, 80.0]
    assert played.above_limit.tolist() == [[2.0] * 4, [4.0] * 4]
    assert played.samples.tolist() == [1.0, 4.0]
    assert played.samples_above.tolist() == [[1.0, 0.0, 0.0, 1.0], [4.0, 0.0, 0.0, 4.0]]
    assert played.samples_any.tolist() == [1.0, 4.0]


def test_episodes_are_those_of_their_seed_however_many_worlds(solo12, policies, short):
    first = play_episodes(solo12, policies, 6, worlds=4, seed=3)
    again = play_episodes(solo12, policies, 6, worlds=4, seed=3)
    other = play_episodes(solo12, policies, 6, worlds=4, seed=9)
    assert first.error.shape == (6,)
    assert first.above_limit.shape == (6, 4)
    assert {values.shape for values in first.parameters.values()} == {(6,)}
    assert len(set(first.parameters["friction"].tolist())) == 6
    assert np.array_equal(first.error, again.error)
    assert not np.array_equal(first.error, other.error)
    assert len(set(first.error.tolist())) == 6, "no episode is played twice"


def test_every_substep_of_every_foot_is_counted(solo12, policies, short):
    """Bug B15: 0.4 s are 120 substeps, all of them looked at."""
    played = play_episodes(solo12, policies, 4, worlds=4, seed=0)
    assert not played.fell.any()
    assert played.substeps.tolist() == [120.0] * 4


def test_evaluation_is_without_noise_and_with_the_motors_as_they_are(
    solo12, policies, short, monkeypatch
):
    seen = []
    make = episodes.LeggedEnv

    def watched(spec, task, worlds, **options):
        seen.append(task)
        return make(spec, task, worlds, **options)

    monkeypatch.setattr(episodes, "LeggedEnv", watched)
    play_episodes(solo12, policies, 2, worlds=2, seed=0)
    assert seen[0].noise == 0.0
    assert seen[0].training_limits is False
    assert seen[0].randomisation == load_task(solo12, "reach").randomisation, "pushes included"


def test_robots_and_floors_of_one_s_own(solo12, policies, short):
    usual = load_task(solo12, "reach").randomisation
    heavy = replace(usual, friction=(1.45, 1.45), mass_scale=(1.2, 1.2))
    played = play_episodes(solo12, policies, 3, worlds=3, seed=0, randomisation=heavy)
    assert played.parameters["friction"].tolist() == pytest.approx([1.45] * 3)
    assert played.parameters["mass_scale"].tolist() == pytest.approx([1.2] * 3)


def test_without_a_high_level_latents_are_random(solo12, policies, short):
    alone = {"low": policies["low"]}
    played = play_episodes(solo12, alone, 3, worlds=3, seed=0)
    steered = play_episodes(solo12, policies, 3, worlds=3, seed=0)
    assert not np.array_equal(played.error, steered.error)
    assert np.array_equal(played.error, play_episodes(solo12, alone, 3, worlds=3, seed=0).error)


def test_intervals_are_those_of_the_episodes():
    """The interval of a mean is about +-1.96 standard errors; that of no falls in 400 episodes is
    the exact one, below 0.92 %.
    """
    error = np.random.default_rng(0).exponential(0.02, 400)
    none = np.zeros(400)
    played = Episodes(
        error, none.astype(bool), none[:, None], none + 9, none + 1, none[:, None], none, THRESHOLDS
    )
    found = played.intervals()
    assert set(found) == set(episodes.METRICS)
    assert found == played.intervals(), "a fixed seed"
    half = 1.96 * error.std() / 20
    assert found["ee_error_mean_m"] == pytest.approx(
        [error.mean() - half, error.mean() + half], abs=2e-4
    )
    assert found["falls_pct"] == pytest.approx([0.0, 0.918], abs=1e-3)
    low, high = found["success_5cm_pct"]
    assert low < played.metrics()["success_5cm_pct"] < high
