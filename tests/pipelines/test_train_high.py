"""High-level training over a frozen low level."""

from dataclasses import replace
from types import SimpleNamespace

import pytest
import torch

from lacoloco.pipelines.evaluation.episodes import play_episodes
from lacoloco.pipelines.high_level.config import CONTACT_FORCE_PENALTY
from lacoloco.pipelines.high_level.trainer import HighTrainer
from lacoloco.pipelines.high_level.trials import try_latents
from lacoloco.pipelines.learn.networks import NetworkConfig, make_actor
from lacoloco.pipelines.learn.ppo import PpoConfig
from lacoloco.pipelines.policies import Head, Policy
from lacoloco.pipelines.sim.hierarchical_env import HOLD_STEPS
from lacoloco.pipelines.sim.tasks import load_task
from lacoloco.pipelines.train_high import smoke, was_constrained, with_contact_force_penalty


def low_level(latent_dim=7):
    """An untrained low level of Solo12, as it comes from a file."""
    torch.manual_seed(0)
    sizes, networks = {"policy": 46, "latent": latent_dim}, NetworkConfig(actor=(16,))
    actor = make_actor(sizes, 12, networks).eval()
    return Policy(Head("low", sizes, 12, networks, [], "imitate"), actor)


@pytest.fixture
def low():
    return low_level()


@pytest.fixture
def make_trainer(solo12, low):
    def factory(horizon=3, **changes):
        config = replace(
            smoke(), ppo=PpoConfig(horizon=horizon, epochs=1, minibatches=1), **changes
        )
        return HighTrainer(solo12, low, config, seed=0, device="cpu")

    return factory


def test_the_low_level_stays_as_it_is(make_trainer, low):
    before = {name: value.clone() for name, value in low.actor.state_dict().items()}
    trainer = make_trainer()
    high = [parameter.clone() for parameter in trainer.algorithm.actor.parameters()]
    trainer.pretrain()
    trainer.iterate(0.5)
    for name, value in low.actor.state_dict().items():
        assert torch.equal(value, before[name]), name
    assert any(
        not torch.equal(old, new)
        for old, new in zip(high, trainer.algorithm.actor.parameters(), strict=True)
    )


def test_latents_have_the_dimension_of_the_low_level(solo12):
    low, task = low_level(16), replace(load_task(solo12, "reach"), episode_s=0.2)
    trainer = HighTrainer(solo12, low, replace(smoke(), worlds=4), seed=0, device="cpu")
    assert trainer.head.sizes == {"policy": 34 + 3 + 16}
    assert trainer.head.layout[-1]["slice"] == [37, 53]
    assert trainer.pretrain()["model_error"] > 0.0
    trainer.iterate(0.5)
    both = {"low": low, "high": trainer.policy()}
    assert play_episodes(solo12, both, 2, worlds=2, seed=0, task=task).error.shape == (2,)


def test_the_low_level_is_steered_by_unit_latents_and_acts_on_its_mean(make_trainer, low):
    trainer, seen = make_trainer(), []
    trainer.env.low = lambda obs, z: (seen.append((obs, z)), low(obs, z))[1]
    trainer.iterate(0.0)
    assert len(seen) == 3 * HOLD_STEPS
    for decision in range(3):
        latents = [z for _, z in seen[decision * HOLD_STEPS : (decision + 1) * HOLD_STEPS]]
        assert all(torch.equal(z, latents[0]) for z in latents)
        assert torch.allclose(latents[0].norm(dim=-1), torch.ones(16), atol=1e-5)
    obs, z = seen[0]
    assert torch.equal(low(obs, z), low(obs, z)), "no sampling"
    assert not torch.equal(seen[0][1], seen[HOLD_STEPS][1])


def test_what_is_observed_is_the_latent_of_the_decision_before(make_trainer):
    """Bug B8: the original shows the last latent of the previous rollout instead."""
    trainer = make_trainer(horizon=4)
    for _ in range(2):
        trainer.iterate(0.0)
        observed = trainer.algorithm.storage.observations["policy"][..., -7:]
        acted = torch.nn.functional.normalize(trainer.algorithm.storage.actions, dim=-1)
        alive = ~trainer.algorithm.done[:-1]
        assert torch.allclose(observed[1:][alive], acted[:-1][alive], atol=1e-6)
    assert float(observed[0].norm(dim=-1).max()) > 0.99, "also across rollouts"


def test_rewards_are_means_over_the_five_steps_times_the_scale(make_trainer, monkeypatch):
    trainer = make_trainer(horizon=2, reward_scale=7.0)
    step, paid = trainer.env.env.step, []

    def counted(action):
        outcome = step(action)
        paid.append(outcome.reward)
        return outcome

    monkeypatch.setattr(trainer.env.env, "step", counted)
    trainer.iterate(0.0)
    first = 7.0 * torch.stack(paid[:HOLD_STEPS]).mean(0)
    alive = ~trainer.algorithm.done[0]
    found = trainer.algorithm.storage.rewards[0, :, 0]
    assert torch.allclose(found[alive], first[alive], atol=1e-6)


def test_contact_forces_above_the_limit_have_their_penalty(make_trainer):
    """A quarter of all foot-substeps above it costs a quarter of the penalty, half of that half way
    up its ramp, nothing before it.
    """
    rewards = []
    for penalty, progress in ((None, 1.0), (8.0, 1.0), (8.0, 0.35), (8.0, 0.1)):
        trainer = make_trainer(horizon=2, contact_force_penalty=penalty, std=(0.3, 0.3))
        step = trainer.env.step

        def violating(z, step=step):
            decision = step(z)
            above = torch.zeros_like(decision.above_limit)
            above[:, 1] = decision.substeps
            return replace(decision, above_limit=above)

        trainer.env.step = violating
        trainer.iterate(progress)
        rewards.append(trainer.algorithm.storage.rewards.clone())
    for paid, asked in zip(rewards, (0.0, 2.0, 1.0, 0.0), strict=True):
        torch.testing.assert_close((rewards[0] - paid)[0], torch.full_like(paid[0], asked))


def test_the_penalty_is_for_low_levels_that_were_constrained():
    def penalty(config, constrained):
        return with_contact_force_penalty(config, constrained).contact_force_penalty

    assert penalty(smoke(), True) == CONTACT_FORCE_PENALTY
    assert penalty(smoke(), False) == 0.0
    assert penalty(replace(smoke(), contact_force_penalty=3.0), False) == 3.0


def test_an_artifact_says_whether_its_low_level_was_constrained():
    def header(method, **config):
        return SimpleNamespace(config=config, metadata={"method": method})

    assert was_constrained(header("drail", cat=True))
    assert not was_constrained(header("drail-cat", cat=False))
    assert was_constrained(header("gan-cat")), "both levels: the config is the high level's"


@pytest.mark.parametrize(
    ("progress", "error", "same"), [(0.3, 1.0, False), (0.9, 1.0, True), (0.9, 0.2, False)]
)
def test_a_failed_episode_has_the_same_target_again(make_trainer, progress, error, same):
    """From a share of the training on, and if it ended further away than 0.3 m."""
    trainer = make_trainer(horizon=1, restart_probability=1.0)
    env = trainer.env.env
    step, miss = trainer.env.step, torch.zeros(16, dtype=torch.bool)

    def ended(z):
        outcome = step(z)
        where = miss & ~outcome.fell
        return replace(outcome, timed_out=where, error=torch.where(where, error, outcome.error))

    trainer.env.step = ended
    miss[:8] = True
    trainer.iterate(progress)  # from here on it is known how the first eight began
    begun, target = env.steps.eq(0), env.command.clone()
    miss[:8] = False
    for _ in range(9):
        trainer.iterate(progress)
    alive = begun & env.steps.eq(9 * HOLD_STEPS)
    miss[:8] = True
    trainer.iterate(progress)
    ended_now = alive & env.steps.eq(0)
    assert ended_now.any()
    kept = (env.command == target).all(dim=1)
    assert bool(kept[ended_now].all()) is same
    assert same or not kept[ended_now].any()


def test_time_outs_fall_on_the_end_of_a_decision(make_trainer):
    """An episode has 500 steps and starts anywhere, but always between two decisions."""
    trainer = make_trainer()
    assert not (trainer.env.env.steps % HOLD_STEPS).any()
    assert len(trainer.env.env.steps.unique()) > 5
    assert trainer.env.env.task.episode_steps % HOLD_STEPS == 0


def test_the_actor_waits_for_its_critic(make_trainer):
    """What pretraining taught must not be undone by the first advantages of a critic that knows
    nothing.
    """
    trainer = make_trainer()
    begin = [parameter.clone() for parameter in trainer.algorithm.actor.mlp.parameters()]
    assert trainer.pretrain()["predicted_distance"] > 0.0
    taught = [parameter.clone() for parameter in trainer.algorithm.actor.mlp.parameters()]
    assert not all(map(torch.equal, begin, taught))
    trainer.iterate(0.0)
    assert all(map(torch.equal, taught, trainer.algorithm.actor.mlp.parameters()))
    trainer.iterate(0.5)
    assert not all(map(torch.equal, taught, trainer.algorithm.actor.mlp.parameters()))


def test_a_pretrained_policy_keeps_its_statistics(make_trainer):
    trainer = make_trainer()
    normalizer = trainer.algorithm.actor.obs_normalizer
    before = normalizer.mean.clone()
    trainer.pretrain()
    taught = normalizer.mean.clone()
    assert not torch.equal(before, taught), "those of what latents were tried on"
    trainer.iterate(0.5)
    assert torch.equal(taught, normalizer.mean)


def test_statistics_follow_where_no_pretraining_made_them(solo12, low):
    """A task without a target begins with a random network."""
    task = load_task(solo12, "walk")
    config = replace(smoke(), ppo=PpoConfig(horizon=3, epochs=1, minibatches=1))
    trainer = HighTrainer(solo12, low, config, seed=0, device="cpu", task=task)
    mean = trainer.algorithm.actor.obs_normalizer.mean.clone()
    assert trainer.pretrain() == {}
    trainer.iterate(0.5)
    assert not torch.equal(mean, trainer.algorithm.actor.obs_normalizer.mean)


def test_from_the_second_round_on_the_policy_steers_half_of_the_time(make_trainer):
    env = make_trainer().env
    mine = torch.nn.functional.normalize(torch.ones(7), dim=0)
    config, held = replace(smoke().skill_dynamics, decisions=24, hold=(4, 5)), []

    def policy(obs):
        held.append((env.latent == mine).all(dim=-1))
        return mine.expand(len(obs), -1)

    trials = try_latents(env, config, torch.Generator().manual_seed(0), policy)
    assert 0.3 < torch.stack(held).float().mean() < 0.7
    assert len(trials.obs) > 0
    assert not (trials.latent == mine).all(dim=-1).any()


@pytest.mark.parametrize(("share", "least", "most"), [(0.0, 0.0, 0.25), (1.0, 0.9, 1.0)])
def test_latents_are_tried_around_those_of_the_policy(make_trainer, share, least, most):
    mine = torch.nn.functional.normalize(torch.ones(7), dim=0)
    config = replace(smoke().skill_dynamics, decisions=40, hold=(4, 5), near_share=share)
    generator = torch.Generator().manual_seed(0)
    trials = try_latents(make_trainer().env, config, generator, lambda obs: mine.expand(16, -1))
    # The first latents of all are drawn before the policy is asked.
    close = (trials.latent @ mine)[len(trials.obs) // 2 :] > 0.7
    assert least <= close.float().mean() <= most


def test_some_worlds_see_without_noise(make_trainer):
    env = make_trainer(noise_free_fraction=0.25).env.env
    clean = (env.noise == 0.0).squeeze(-1)
    assert int(clean.sum()) == 4
    assert clean[3::4].all(), "spread over the worlds"
    seen = (env.observe()[:, :34] - env.frame()).abs().amax(dim=1)
    assert (seen[clean] == 0.0).all()
    assert (seen[~clean] > 0.0).all()


def test_samples_are_control_steps(make_trainer):
    trainer = make_trainer(horizon=3)
    assert trainer.samples_per_iteration == 16 * 3 * HOLD_STEPS
    assert replace(trainer.config, decisions=16 * 3 * 10).decisions // (16 * 3) == 10
    trainer.config = replace(trainer.config, decisions=16 * 3 * 10)
    assert trainer.iterations == 10


def test_the_use_of_latents_is_that_of_the_mean_decisions(make_trainer):
    trainer = make_trainer(std=(50.0, 50.0))
    with torch.no_grad():
        trainer.algorithm.actor.mlp[-1].weight.zero_()
        trainer.algorithm.actor.mlp[-1].bias.copy_(torch.eye(7)[2])
    metrics = trainer.iterate(0.0)
    assert metrics["latent_resultant"] == pytest.approx(1.0, abs=1e-5), "whatever the noise"
    assert metrics["latent_directions"] == pytest.approx(1.0, abs=1e-3)
    assert metrics["speed"] > 0.0


def test_a_fall_is_undone_with_its_target_and_latent(make_trainer, monkeypatch):
    """And counted all the same, but not what comes of the retry."""
    trainer = make_trainer(horizon=14, restart_probability=1.0)
    env, reality, seen = trainer.env, trainer.env.step, []

    def unlucky(z):
        decision = reality(z)
        seen.append((env.env.command.clone(), env.latent.clone()))
        return replace(
            decision,
            fell=torch.full_like(decision.fell, len(seen) in (14, 15)),
            timed_out=torch.zeros_like(decision.fell),
        )

    monkeypatch.setattr(env, "step", unlucky)
    metrics = trainer.iterate(0.5)
    assert (metrics["falls_per_episode"], metrics["episodes"]) == (1.0, 16.0)
    assert torch.equal(env.env.command, seen[0][0]), "nobody got a new target"
    assert any(torch.equal(env.latent[3], latent[3]) for _, latent in seen[:6]), "a second before"
    assert not env.env.steps.any()
    assert trainer.iterate(0.5)["episodes"] == 0.0, "it fell again at once"


def test_contact_forces_are_counted_per_foot_and_substep(make_trainer, monkeypatch):
    trainer = make_trainer(horizon=2)
    reality = trainer.env.step
    above = torch.zeros(16, 4)
    above[3, 1] = 5.0
    monkeypatch.setattr(trainer.env, "step", lambda z: replace(reality(z), above_limit=above))
    substeps = HOLD_STEPS * trainer.env.env.physics.foot_force.shape[1]
    assert trainer.iterate(0.0)["contact_violation"] == pytest.approx(
        5.0 / (16 * 4 * substeps), rel=0.05
    )


def test_bold_spells_keep_the_std_of_the_start(make_trainer):
    trainer = make_trainer(std=(0.4, 0.1))
    trainer.iterate(1.0)
    assert trainer.algorithm.exploration.high_noise_scale == pytest.approx(4.0)


def test_what_training_adds_to_the_task(make_trainer, solo12):
    task, trained = load_task(solo12, "reach"), make_trainer().env.env.task
    assert trained.rewards == task.rewards
    assert task.fall_tilt is None, "an evaluated fall is what touches the ground"
    assert trained.fall_tilt == pytest.approx(1.05)
