"""Which of a training's policies is kept."""

from __future__ import annotations

from dataclasses import replace

import pytest
import torch

from lacoloco.pipelines.evaluation.robustness import latent_switching_robustness
from lacoloco.pipelines.low_level import checkpoint_selection
from lacoloco.pipelines.low_level.checkpoint_selection import OTHER_SEED, Selection, score
from lacoloco.pipelines.low_level.trainer import LowTrainer
from lacoloco.pipelines.sim.env import LeggedEnv
from lacoloco.pipelines.train_low import smoke

CLIPS = {"clips_walk": 0.5, "clips_reach": 0.3, "clips_stand": 0.2}


def metrics(
    walk: float, reach: float, stand: float, fall: float, steered: float, cells: float = 1.0
) -> dict[str, float]:
    shares = {"walk": walk, "reach": reach, "stand": stand, "fall": fall}
    return (
        {f"coverage_{name}": share for name, share in shares.items()}
        | CLIPS
        | {"switching_fall_rate": steered, "coverage_cells": cells}
    )


def test_the_clips_own_shares_without_a_fall_score_zero():
    assert score(metrics(0.5, 0.3, 0.2, 0.0, 0.0)) == pytest.approx(0.0)
    assert score(metrics(1.0, 0.0, 0.0, 0.0, 0.0)) == pytest.approx(0.5), (
        "half of the latents do something else"
    )
    assert score(metrics(0.5, 0.3, 0.2, 0.0, 0.05)) == pytest.approx(0.2)
    assert score(metrics(0.5, 0.3, 0.2, 0.0, 0.0, cells=0.6)) == pytest.approx(0.4), (
        "it walks and reaches as often, and does not turn"
    )


@pytest.fixture
def trainer(solo12, motions):
    return LowTrainer(solo12, motions, smoke(), seed=0, device="cpu")


def examined(trainer: LowTrainer, values: list[float]) -> list[dict[str, float]]:
    """Examine the actor with its first weight at 0, 1, ... and a made-up coverage whose score is
    each of ``values``.
    """
    seen = []
    weight = next(trainer.algorithm.actor.parameters())
    for number, value in enumerate(values):
        with torch.no_grad():
            weight.flatten()[0] = number
        trainer.selection.measure = lambda actor, value=value: metrics(
            0.5 + value, 0.3 - value, 0.2, 0.0, 0.0
        )
        seen.append(trainer.selection.examine(trainer.algorithm.actor, 100 * number))
    return seen


def test_the_best_is_kept_and_survives_a_checkpoint(trainer, solo12, motions):
    shares = [0.2, 0.1, 0.3]
    steered = examined(trainer, shares)[0]["switching_fall_rate"]
    assert trainer.selection.chosen["samples"] == 100
    assert trainer.selection.chosen["metrics"]["score"] == pytest.approx(0.1 + 4.0 * steered)
    other = LowTrainer(solo12, motions, smoke(), seed=0, device="cpu")
    other.load_state_dict(trainer.state_dict())
    for policy in (trainer.policy(), other.policy()):
        assert float(next(policy.actor.parameters()).flatten()[0]) == 1.0
    assert float(next(trainer.algorithm.actor.parameters()).flatten()[0]) == 2.0, (
        "the training goes on with its own"
    )


def test_the_chosen_policy_is_measured_again_on_other_seeds(trainer, monkeypatch):
    """It was chosen for 0.1; elsewhere it is 0.4 from the clips' shares and falls once in ten."""
    seeds, falls = [], {0: 0.0, OTHER_SEED: 0.1}

    def robustness(spec, policy, *, worlds, seed):
        seeds.append(seed)
        return {"switching_fall_rate": falls[seed]}

    def measure(selection, actor):
        assert float(next(actor.parameters()).flatten()[0]) == 1.0, "the chosen weights"
        return metrics(0.9, 0.0, 0.1, 0.0, 0.0)

    monkeypatch.setattr(checkpoint_selection, "latent_switching_robustness", robustness)
    examined(trainer, [0.2, 0.1, 0.3])
    before = trainer.selection.chosen
    monkeypatch.setattr(Selection, "measure", measure)
    closing = trainer.selection.confirm(trainer.algorithm.actor)
    assert seeds == [0, 0, 0, OTHER_SEED]
    assert closing["score"] == pytest.approx(0.4 + 4.0 * 0.1)
    assert closing["chosen_score"] == pytest.approx(0.1)
    assert closing["chosen_after"] == 100.0
    assert trainer.selection.chosen is before


def test_it_is_chosen_with_the_motors_that_it_is_evaluated_with(trainer, solo12, monkeypatch):
    """3 N.m, as the MJCF has them; in training they have 4.5."""
    strong = [trainer.selection.coverage.env]
    built = LeggedEnv.__init__

    def watched(env, *arguments, **options):
        built(env, *arguments, **options)
        strong.append(env)

    monkeypatch.setattr(LeggedEnv, "__init__", watched)
    latent_switching_robustness(solo12, trainer.policy(), worlds=2, seconds=0.02)
    assert len(strong) == 2
    assert not any(env.task.training_limits for env in strong)


def test_only_what_comes_after_the_ramp_is_examined(solo12, motions):
    config = replace(smoke(), samples=128 * 5, coverage_every=128, choose_from=0.6)
    trainer = LowTrainer(solo12, motions, config, seed=0, device="cpu")
    assert ["score" in trainer.iterate(step / 5) for step in range(5)] == [False] * 3 + [True] * 2


def test_robustness_counts_episodes_and_forces_and_repeats_itself(trainer, solo12):
    """A policy that commands the default pose stands through pushes; one that commands nonsense
    does not.
    """
    policy = trainer.policy()
    layers = [module for module in policy.actor.modules() if isinstance(module, torch.nn.Linear)]
    with torch.no_grad():
        layers[-1].weight.zero_(), layers[-1].bias.zero_()
    calm = latent_switching_robustness(solo12, policy, worlds=16, seconds=2.0)
    assert calm["switching_fall_rate"] == 0.0
    assert calm["switching_violation_rate"] < 0.001, "four feet carry a quarter of the limit each"
    with torch.no_grad():
        layers[-1].bias.fill_(3.0)
    wild = latent_switching_robustness(solo12, policy, worlds=16, seconds=2.0)
    assert wild == latent_switching_robustness(solo12, policy, worlds=16, seconds=2.0)
    assert wild["switching_fall_rate"] > 0.5
    assert wild["switching_violation_rate"] > calm["switching_violation_rate"]
