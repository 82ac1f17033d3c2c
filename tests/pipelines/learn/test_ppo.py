"""PPO: what it records, what it learns from, and from whom."""

import math
from dataclasses import replace

import pytest
import torch
from tensordict import TensorDict

from lacoloco.pipelines.learn.networks import NetworkConfig, set_std
from lacoloco.pipelines.learn.ppo import EXPLORE, Ppo

NETWORKS = NetworkConfig(actor=(16,), critic=(16,), init_std=0.5)

NOBODY = torch.zeros(4, dtype=torch.bool)


def world(*ids):
    mask = NOBODY.clone()
    mask[list(ids)] = True
    return mask


def fill(ppo, observe, rewards=0.0):
    """Record one rollout of constant rewards without any episode ending."""
    worlds, horizon = ppo.num_worlds, ppo.config.horizon
    nobody = torch.zeros(worlds, dtype=torch.bool)
    for step in range(horizon):
        ppo.act(observe(worlds, seed=step))
        ppo.record(torch.full((worlds,), rewards), nobody, nobody, observe(worlds, seed=step + 1))
    return observe(worlds, seed=horizon)


def value(ppo, obs):
    with torch.no_grad():
        return ppo.critic(obs).squeeze(-1)


def test_deterministic_steps_act_on_the_mean_and_say_so(make_ppo, observe):
    ppo, obs = make_ppo(), observe()
    ppo.exploration.probability = torch.tensor([1.0, 0.0, 1.0, 0.0])
    action = ppo.act(obs)
    with torch.no_grad():
        off = (action - ppo.actor(obs)).abs().amax(dim=-1)
    assert (off > 1e-4).tolist() == [True, False, True, False]
    assert obs[EXPLORE].flatten().tolist() == [1.0, 0.0, 1.0, 0.0]


def test_bold_steps_go_further_and_know_how_likely_that_was(make_ppo, observe):
    ppo, obs = make_ppo(high_noise_fraction=1.0), observe()
    ppo.exploration.high_noise_scale = 3.0
    action = ppo.act(obs)
    assert obs[EXPLORE].flatten().tolist() == [3.0] * 4
    mean, std = ppo.transition.distribution_params
    expected = torch.distributions.Normal(mean, 3.0 * std).log_prob(action).sum(dim=-1)
    assert torch.allclose(ppo.transition.actions_log_prob.flatten(), expected, atol=1e-4)
    far = torch.cat(
        [
            (ppo.act(observe(seed=step)) - ppo.transition.distribution_params[0]) / std
            for step in range(300)
        ]
    )
    assert float(far.std()) == pytest.approx(3.0, rel=0.1)


def test_bold_steps_pull_as_a_wider_gaussian_would(make_ppo, observe):
    """The gradient of the surrogate is that of plain PPO whose std is the larger one."""
    gradients = []
    for std, high_noise_scale in ((0.6, 1.0), (0.2, 3.0)):
        ppo = make_ppo(horizon=1, high_noise_fraction=1.0)
        set_std(ppo.actor, std)
        ppo.exploration.high_noise_scale = high_noise_scale
        torch.manual_seed(3)
        ppo.compute_returns(fill(ppo, observe, rewards=1.0))
        ppo.storage.advantages[0, :, 0] = torch.tensor([0.5, 1.0, -0.5, -1.0])
        loss, metrics = ppo._loss(next(iter(ppo.storage.mini_batch_generator(1, 1))))
        loss.backward()
        gradients.append([p.grad.clone() for p in ppo.actor.parameters() if p.grad is not None])
        assert float(metrics["kl"]) == pytest.approx(0.0, abs=1e-6)
    for plain, scaled in zip(*gradients, strict=True):
        assert torch.allclose(plain, scaled, atol=1e-5)
    assert max(float(g.abs().max()) for g in gradients[0]) > 0


def test_deterministic_steps_have_no_say_in_the_policy(make_ppo, observe):
    """Whatever their advantage: only the critic learns from them."""
    gradients = []
    for gain in (1.0, 1000.0):
        ppo = make_ppo(horizon=1)
        ppo.exploration.probability = torch.tensor([1.0, 0.0, 1.0, 0.0])
        last = fill(ppo, observe)
        ppo.compute_returns(last)
        ppo.storage.advantages[0, :, 0] = torch.tensor([0.5, gain, -0.5, -gain])
        # At the mean itself the likelihood is flat: only beside it could they have a say at all.
        ppo.storage.actions[0, [1, 3]] += 0.3
        loss, _ = ppo._loss(next(iter(ppo.storage.mini_batch_generator(1, 1))))
        loss.backward()
        gradients.append([p.grad.clone() for p in ppo.actor.parameters() if p.grad is not None])
    for ours, theirs in zip(*gradients, strict=True):
        assert torch.equal(ours, theirs)
    assert max(float(g.abs().max()) for g in gradients[0]) > 0


def test_advantages_are_normalised_over_the_exploring_steps(make_ppo, observe):
    ppo = make_ppo(worlds=6, horizon=8)
    ppo.exploration.probability = torch.tensor([1.0, 1.0, 1.0, 0.5, 0.0, 0.0])
    for step in range(8):
        ppo.act(observe(6, seed=step))
        nobody = torch.zeros(6, dtype=torch.bool)
        ppo.record(torch.randn(6), nobody, nobody, observe(6, seed=step + 1))
    ppo.compute_returns(observe(6, seed=8))
    explore = ppo.storage.observations[EXPLORE] > 0
    chosen = ppo.storage.advantages[explore]
    assert float(chosen.mean()) == pytest.approx(0.0, abs=1e-5)
    assert float(chosen.std()) == pytest.approx(1.0, abs=1e-3)
    assert len(chosen) < 48


def test_returns_of_a_time_out_a_fall_and_a_soft_termination(make_ppo, observe):
    """One step, gamma 0.9: r (1 - delta) + gamma (1 - delta) V(next); the last obs are post-reset.

    World 0 lives, 1 falls, 2 times out (and is worth its true last state: bugs B3 and B9), 3 is
    terminated by half.
    """
    ppo = make_ppo(horizon=1, gamma=0.9)
    ppo.act(observe())
    true_next, after_reset = observe(seed=1), observe(seed=2)
    after_reset["policy"][[0, 3]] = true_next["policy"][[0, 3]]
    ppo.record(
        torch.ones(4), world(1), world(2), true_next, delta=torch.tensor([0.0, 0.0, 0.0, 0.5])
    )
    ppo.compute_returns(after_reset)
    following = value(ppo, true_next)
    expected = torch.stack(
        [
            1 + 0.9 * following[0],
            torch.tensor(1.0),
            1 + 0.9 * following[2],
            0.5 + 0.45 * following[3],
        ]
    )
    assert torch.allclose(ppo.storage.returns[0, :, 0], expected, atol=1e-5)
    assert not torch.allclose(value(ppo, after_reset)[2], following[2], atol=1e-3)


def test_an_episode_that_ends_inside_a_rollout_learns_nothing_from_the_next_one(make_ppo, observe):
    """Bug B2: rewards after the reset must not flow back over it."""
    returns = []
    for later in (0.0, 100.0):
        ppo = make_ppo(horizon=2, lam=1.0)
        for step, reward in enumerate((1.0, later)):
            ppo.act(observe(seed=step))
            ends = NOBODY if step else world(0, 1)
            fell, timed_out = ends & world(0), ends & world(1)
            ppo.record(torch.full((4,), reward), fell, timed_out, observe(seed=10 + step))
        ppo.compute_returns(observe(seed=20))
        returns.append(ppo.storage.returns[0, :, 0])
    assert torch.equal(returns[0][:2], returns[1][:2])
    assert (returns[1][2:] > returns[0][2:] + 50).all()


def test_a_penalty_is_not_smaller_where_a_constraint_is_violated(make_ppo, observe):
    """All fall, so nothing follows: -1 stays -1, where the reward of 1 is halved."""
    ppo = make_ppo(horizon=1)
    ppo.act(observe())
    reward = torch.tensor([1.0, 1.0, -1.0, -1.0])
    delta = torch.tensor([0.0, 0.5, 0.0, 0.5])
    ppo.record(reward, ~NOBODY, NOBODY, observe(seed=1), delta=delta)
    ppo.compute_returns(observe(seed=1))
    returns = ppo.storage.returns[0, :, 0].tolist()
    assert returns == pytest.approx([1.0, 0.5, -1.0, -1.0], abs=1e-6)


def test_recorded_rewards_are_not_changed_behind_the_callers_back(make_ppo, observe):
    ppo = make_ppo(horizon=1)
    ppo.act(observe())
    reward = torch.ones(4)
    ppo.record(reward, NOBODY, NOBODY, observe(seed=1), delta=torch.full((4,), 0.5))
    ppo.compute_returns(observe(seed=1))
    assert reward.tolist() == [1.0] * 4


def test_minibatches_are_shuffled_over_all_worlds(make_ppo, observe):
    """Bug B10: each of the original's minibatches is one block of worlds."""
    ppo = make_ppo(worlds=16, horizon=16, minibatches=4)
    for step in range(16):
        obs = observe(16, seed=step)
        obs["policy"][:, 0] = torch.arange(16.0)
        nobody = torch.zeros(16, dtype=torch.bool)
        ppo.act(obs)
        ppo.record(torch.zeros(16), nobody, nobody, obs)
    ppo.compute_returns(obs)
    seen = []
    for batch in ppo.storage.mini_batch_generator(4, 1):
        worlds = batch.observations["policy"][:, 0].tolist()
        assert len(set(worlds)) >= 14, "64 of 256 rows: nearly every world"
        seen += worlds
    assert sorted(seen) == sorted(list(range(16)) * 16)


def test_the_surrogate_is_clipped(make_ppo, observe):
    """min(ratio A, clip(ratio, 0.8, 1.2) A), by moving the old log-probabilities."""
    ppo = make_ppo(horizon=1)
    last = fill(ppo, observe)
    ppo.compute_returns(last)
    ppo.storage.actions_log_prob += torch.tensor(
        [0.0, -math.log(1.5), -math.log(1.5), math.log(2)]
    )[:, None]
    gains = torch.tensor([1.0, 1.0, -1.0, -1.0])
    ppo.storage.advantages[0, :, 0] = gains
    _, metrics = ppo._loss(next(iter(ppo.storage.mini_batch_generator(1, 1))))
    # ratios 1, 1.5, 1.5, 0.5
    expected = -(1.0 + 1.2 - 1.5 - 0.8) / 4
    assert float(metrics["surrogate"].detach()) == pytest.approx(expected, rel=1e-4)


def test_learning_rate_follows_the_kl(make_ppo, observe):
    config = {"horizon": 1, "learning_rate": 1e-3, "desired_kl": 0.01}
    rates = {}
    for moved in (0.0, 0.05, 1.0):
        ppo = make_ppo(**config)
        last = fill(ppo, observe)
        ppo.compute_returns(last)
        ppo.storage.distribution_params[0].add_(moved)  # the old mean, std 0.5
        ppo._loss(next(iter(ppo.storage.mini_batch_generator(1, 1))))
        rates[moved] = ppo.learning_rate
        assert ppo.optimizer.param_groups[0]["lr"] == ppo.learning_rate
        assert ppo.optimizer.param_groups[1]["lr"] == ppo.config.critic_learning_rate
    # KL = sum over 2 actions of 0.5 (moved / 0.5)^2: 0, 0.01 and 4.
    assert rates == pytest.approx({0.0: 1.5e-3, 0.05: 1e-3, 1.0: 1e-3 / 1.5})


def test_learning_rate_stays_in_its_range(make_ppo, observe):
    ppo = make_ppo(horizon=1, learning_rate=1e-3, max_learning_rate=1.2e-3, min_learning_rate=9e-4)
    last = fill(ppo, observe)
    ppo.compute_returns(last)
    batch = next(iter(ppo.storage.mini_batch_generator(1, 1)))
    ppo._loss(batch)
    assert ppo.learning_rate == 1.2e-3
    batch.old_distribution_params[0].add_(5.0)
    for _ in range(3):
        ppo._loss(batch)
    assert ppo.learning_rate == 9e-4


def test_a_critic_may_learn_alone(make_ppo, observe):
    ppo = make_ppo()
    before = [parameter.clone() for parameter in ppo.actor.mlp.parameters()]
    critic = [parameter.clone() for parameter in ppo.critic.mlp.parameters()]
    for learns in (False, True):
        ppo.actor_learns = learns
        ppo.compute_returns(fill(ppo, observe, rewards=1.0))
        metrics = ppo.update()
        same = [torch.equal(a, b) for a, b in zip(before, ppo.actor.mlp.parameters(), strict=True)]
        assert all(same) is not learns
        assert ("kl" in metrics) is learns
        assert not any(
            torch.equal(a, b) for a, b in zip(critic, ppo.critic.mlp.parameters(), strict=True)
        )


def test_means_beyond_the_bound_are_pulled_back(make_ppo, observe):
    losses = {}
    for weight in (0.0, 2.0):
        ppo = make_ppo(horizon=1, bound=0.0, bound_weight=weight)
        last = fill(ppo, observe)
        ppo.compute_returns(last)
        (batch,) = ppo.storage.mini_batch_generator(1, 1)
        losses[weight] = float(ppo._loss(batch)[0].detach())
        with torch.no_grad():
            excess = ppo.actor(batch.observations).square().sum(-1).mean()
    assert losses[2.0] - losses[0.0] == pytest.approx(2.0 * float(excess), rel=1e-3)


def test_statistics_of_observations_move_only_after_the_update(make_ppo, observe):
    ppo = make_ppo()
    ppo.warm_up(observe(64, seed=3))
    mean = ppo.actor.obs_normalizer.mean
    assert not torch.equal(mean, torch.zeros(3))
    last = fill(ppo, observe)
    ppo.compute_returns(last)
    assert torch.equal(ppo.actor.obs_normalizer.mean, mean)
    ppo.update()
    assert not torch.equal(ppo.actor.obs_normalizer.mean, mean)
    assert torch.equal(ppo.actor.obs_normalizer.mean, ppo.critic.obs_normalizer.mean)


def test_it_learns_what_to_do_and_what_it_is_worth(make_ppo):
    """Best is to answer the first two numbers with their negatives; episodes last one step."""
    networks = NetworkConfig(actor=(32,), critic=(32,), init_std=0.3)
    ppo = make_ppo(
        worlds=128, horizon=4, epochs=3, minibatches=2, networks=networks, learning_rate=3e-3
    )
    rewards, ends = [], torch.ones(128, dtype=torch.bool)
    for _ in range(40):
        for _ in range(4):
            obs = TensorDict({"policy": torch.rand(128, 3) * 2 - 1}, batch_size=[128])
            action = ppo.act(obs)
            reward = -(action + obs["policy"][:, :2]).square().sum(-1)
            ppo.record(reward, ends, ~ends, obs)
            rewards.append(float(reward.mean()))
        ppo.compute_returns(obs)
        metrics = ppo.update()
    noise = 2 * 0.3**2
    assert sum(rewards[:4]) / 4 < -0.6
    assert sum(rewards[-4:]) / 4 > -noise - 0.06
    assert set(metrics) >= {"surrogate", "value", "kl", "learning_rate", "explained_variance"}


def test_a_critic_may_see_more_than_its_actor(make_ppo, observe):
    """The value depends on the critic's own group, the action does not; both learn."""
    torch.manual_seed(0)
    ppo = Ppo({"policy": 3}, 2, 4, make_ppo().config, NETWORKS, critic_only={"secret": 2})

    def view(worlds=4, seed=0, secret=0.0):
        groups = {**observe(worlds, seed), "secret": torch.full((worlds, 2), secret)}
        return TensorDict(groups, batch_size=[worlds])

    with torch.no_grad():
        seen, other = view(), view(secret=1.0)
        assert torch.equal(ppo.actor(seen), ppo.actor(other))
        assert not torch.allclose(value(ppo, seen), value(ppo, other))
    before = [net.mlp[0].weight.clone() for net in (ppo.actor, ppo.critic)]
    ppo.compute_returns(fill(ppo, view, rewards=1.0))
    ppo.update()
    for net, weight in zip((ppo.actor, ppo.critic), before, strict=True):
        assert not torch.equal(net.mlp[0].weight, weight)
    assert ppo.critic.obs_dim == 5 and ppo.actor.obs_dim == 3


@pytest.mark.parametrize("learned", [True, False])
def test_the_std_moves_with_the_actor_only_if_it_is_learned(make_ppo, observe, learned):
    ppo = make_ppo(networks=replace(NETWORKS, learn_std=learned))
    ppo.compute_returns(fill(ppo, observe))
    ppo.storage.advantages[..., 0] = torch.tensor([1.0, -1.0, 0.5, -0.5])
    before = ppo.actor.distribution.log_std_param.detach().clone()
    ppo.update()
    after = ppo.actor.distribution.log_std_param.detach()
    assert (after != before).all() == learned and torch.equal(after, before) != learned
    again = make_ppo(networks=replace(NETWORKS, learn_std=learned))
    again.load(ppo.save())
    assert torch.equal(again.actor.distribution.log_std_param, after), "a checkpoint carries it"
