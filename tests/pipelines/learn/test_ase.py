"""The adversarial part: style rewards, discriminator and encoder updates, diversity."""

import copy
import math

import pytest
import torch
from small_ase import HORIZON, LATENT, WORLDS, fill, observe

from lacoloco.pipelines.learn.gan import GanConfig
from lacoloco.pipelines.learn.latents import project


@pytest.fixture(params=["gan", "drail"])
def discriminator(request):
    return request.param


def test_a_rollout_is_learned_from_with_either_discriminator(make_ase, discriminator):
    ase = make_ase(discriminator=discriminator)
    before = {k: v.clone() for k, v in ase.discriminator.state_dict().items()}
    ase.compute_returns(fill(ase))
    metrics = ase.update()
    assert {
        "imitation_reward",
        "encoder_cosine",
        "discriminator",
        "encoder",
        "agent_accuracy",
    } <= set(metrics)
    assert all(math.isfinite(value) for value in metrics.values())
    after = ase.discriminator.state_dict()
    assert any(not torch.equal(before[name], after[name]) for name in before)
    assert ase.storage.step == 0, "ready for the next rollout"


def test_style_reward_by_hand(make_ase):
    """scale (w r_D + beta r_E), with D = 0.5 and a known encoder, on top of the task's reward."""
    config = {
        "reward_scale": 0.1,
        "imitation_weight": 2.0,
        "encoder_weight": 0.5,
        "discriminator": "gan",
    }
    ase = make_ase(**config)
    guess = torch.tensor([1.0, 0.0, 0.0])
    ase.discriminator.logits = lambda transition, generator: torch.zeros(len(transition))
    ase.encoder = lambda transition: guess.repeat(len(transition), 1)
    ase.compute_returns(fill(ase, reward=0.3))
    skill = ase.storage.observations["latent"][..., 0].clamp_min(0.0)
    expected = 0.3 + 0.1 * (2.0 * math.log(2.0) + 0.5 * skill)
    assert torch.allclose(ase.storage.rewards.squeeze(-1), expected, atol=1e-6)


def test_transitions_stand_in_time_order_and_at_their_own_step(make_ase):
    """Bug B1: the original's demonstrations are newest first, its agent's oldest first."""
    ase = make_ase()
    fill(ase, frames=lambda step: torch.full((WORLDS, 2), float(step)))
    for step in range(HORIZON):
        expected = torch.tensor([step, step, step + 0.5, step + 0.5]).repeat(WORLDS, 1)
        assert torch.equal(ase.transitions[step], expected)


def test_broken_worlds_earn_and_teach_nothing(make_ase):
    ase, valid = make_ase(), torch.ones(WORLDS, dtype=torch.bool)
    ase.normalizer, valid[2] = Identity(), False
    seen = spy(ase)
    last = fill(
        ase, frames=lambda step: torch.arange(float(WORLDS))[:, None].repeat(1, 2), valid=valid
    )
    ase.compute_returns(last)
    assert torch.equal(ase.storage.rewards[:, 2], torch.zeros(HORIZON, 1))
    assert (ase.storage.rewards[:, [0, 1, 3]] > 0).all()
    ase.update()
    shown = set(worlds_of(torch.cat(seen)))
    assert 2 not in shown
    assert {0, 1, 3} <= shown


def test_statistics_and_metrics_leave_broken_worlds_out(make_ase):
    """World 2 diverges to no number at all, world 5 to far away; the others are as without them."""
    broken = torch.tensor([2, 5])
    valid = torch.ones(WORLDS, dtype=torch.bool)
    valid[broken] = False
    states = torch.randn(HORIZON, WORLDS, 2, generator=torch.Generator().manual_seed(3))
    found = []
    for far in ((0.0, 0.0), (math.nan, 1e6)):
        ase = make_ase()
        frames = states.clone()
        frames[:, broken] += torch.tensor(far)[:, None]
        last = fill(ase, frames=lambda step, frames=frames: frames[step], valid=valid)
        ase.compute_returns(last)
        found.append((ase.normalizer.state_dict(), ase.metrics, ase.storage.rewards))
    (usual, metrics, rewards), (statistics, same_metrics, same_rewards) = found
    assert all(torch.equal(usual[name], statistics[name]) for name in usual)
    assert same_metrics == metrics
    assert torch.equal(rewards, same_rewards)


def spy(ase):
    """Record what the discriminator is shown as the agent's."""
    seen, loss = [], ase.discriminator.loss

    def watched(agent, demo, generator):
        seen.append(agent.detach())
        return loss(agent, demo, generator)

    ase.discriminator.loss = watched
    return seen


def worlds_of(transitions):
    """The numbers that frames were marked with."""
    return transitions[:, 0].round().long().tolist()


class Identity(torch.nn.Module):
    """A normaliser that leaves everything as it is, so that frames can carry marks."""

    def update(self, agent, demo):
        pass

    def forward(self, transition):
        return transition


def test_style_minibatches_draw_from_all_worlds(make_ase):
    """Bug B10: a quarter of the original's worlds never reaches the encoder."""
    ase = make_ase(worlds=64, horizon=4, updates=1, batch=64, replay_share=0.5)
    ase.normalizer = Identity()
    seen = spy(ase)
    last = fill(ase, frames=lambda step: torch.arange(64.0)[:, None].repeat(1, 2))
    ase.compute_returns(last)
    ase.update()
    worlds = worlds_of(seen[0][:32])  # the current half of the batch; the rest is replay
    assert len(set(worlds)) > 16
    assert max(worlds) > 48
    assert min(worlds) < 16


def test_half_of_the_agents_batch_is_replayed(make_ase):
    ase = make_ase(updates=1, batch=16, replay_share=0.25)
    ase.normalizer = Identity()
    old = torch.full((8, 4), 4.0)
    ase.replay.add(old)
    seen = spy(ase)
    ase.compute_returns(fill(ase, frames=lambda step: torch.zeros(WORLDS, 2)))
    ase.update()
    replayed = (seen[0] == 4.0).all(dim=1)
    assert not replayed[:8].any()
    assert replayed[8:].any()
    assert ase.replay.size == 8 + int(0.25 * WORLDS * HORIZON)


def test_the_memory_keeps_raw_transitions(make_ase):
    """Their statistics move on; what is drawn from it is scaled by those of the day."""
    ase = make_ase(updates=1, batch=16, replay_share=1.0)
    ase.compute_returns(fill(ase, frames=lambda step: torch.full((WORLDS, 2), 7.0)))
    seen = spy(ase)
    ase.update()
    kept = ase.replay.data[: ase.replay.size]
    assert torch.equal(kept, torch.tensor([7.0, 7.0, 7.5, 7.5]).repeat(len(kept), 1))
    assert torch.allclose(seen[0], ase.normalizer(kept[:16]))


def test_statistics_are_those_of_the_rollout_before_it_is_judged(make_ase):
    ase = make_ase()
    last = fill(ase, frames=lambda step: torch.full((WORLDS, 2), 9.0))
    before = ase.normalizer.statistics.mean
    ase.compute_returns(last)
    mean = ase.normalizer.statistics.mean
    assert not torch.equal(before, mean)
    assert torch.allclose(mean, torch.tensor(9.25 / 2), atol=0.2), "half agent, half demonstrations"
    ase.update()
    assert torch.equal(ase.normalizer.statistics.mean, mean)


def test_more_updates_than_rows_wrap_around(make_ase):
    ase = make_ase(updates=5, batch=64)
    seen = spy(ase)
    ase.compute_returns(fill(ase))
    ase.update()
    assert [len(each) for each in seen] == [64] * 5


def test_the_encoder_learns_from_the_latent_in_force(make_ase):
    """Transitions that show their latent: the cosine rises."""
    ase = make_ase(worlds=64, updates=20, batch=64, encoder_learning_rate=1e-2)
    cosines = []
    for _ in range(6):
        nobody = torch.zeros(64, dtype=torch.bool)
        for step in range(HORIZON):
            obs = observe(64, step)
            ase.act(obs)
            z = obs["latent"]
            ase.record_transition(z[:, :2], torch.stack([z[:, 2], z[:, 0]], dim=1), ~nobody)
            ase.record(torch.zeros(64), nobody, nobody, obs)
        ase.compute_returns(obs)
        cosines.append(ase.update()["encoder_cosine"])
    assert cosines[0] < 0.5 < 0.9 < cosines[-1]


def test_rewards_under_constraints_are_scaled_once(make_ase):
    """r (1 - delta) in the returns; the stored style reward stays whole."""
    ase = make_ase(horizon=1, discriminator="gan", encoder_weight=0.0, reward_scale=1.0)
    ase.discriminator.logits = lambda transition, generator: torch.zeros(len(transition))
    everyone = torch.ones(WORLDS, dtype=torch.bool)
    ase.act(observe(WORLDS, 0))
    ase.record_transition(torch.zeros(WORLDS, 2), torch.zeros(WORLDS, 2), everyone)
    delta = torch.full((WORLDS,), 0.25)
    ase.record(torch.zeros(WORLDS), everyone, ~everyone, observe(WORLDS, 1), delta)
    ase.compute_returns(observe(WORLDS, 1))
    assert torch.allclose(ase.storage.returns, torch.tensor(0.75 * math.log(2.0)), atol=1e-5)


def test_save_and_load_go_on_bit_for_bit(make_ase, discriminator):
    first = make_ase(discriminator=discriminator)
    first.compute_returns(fill(first))
    first.update()
    second = make_ase(discriminator=discriminator, seed=9)
    second.load(copy.deepcopy(first.save()))
    results = []
    for ase in (first, second):
        torch.manual_seed(5)
        ase.compute_returns(fill(ase))
        results.append(ase.update())
    assert results[0] == results[1]
    for ours, theirs in zip(first.actor.parameters(), second.actor.parameters(), strict=True):
        assert torch.equal(ours, theirs)


def test_an_anchored_encoder_learns_the_latents_of_demonstrations(make_ase):
    """Label and transition are related, so that the encoder can agree with them."""

    def labelled(count, generator):
        transitions = torch.randn(count, 4, generator=generator)
        return transitions, project(transitions[:, :LATENT])

    ase = make_ase(encoder_learning_rate=3e-3)
    ase.labelled = labelled
    assert ase.fit_encoder(150, batch=256) > 0.9

    def agreement():
        transitions, z = labelled(500, torch.Generator().manual_seed(5))
        return float((ase.encoder(ase.normalizer(transitions)) * z).sum(dim=-1).mean())

    assert agreement() > 0.85


def test_the_anchor_holds_while_the_policy_says_otherwise(make_ase):
    """Random latents say nothing about random transitions: only the labels can keep the encoder."""

    def labelled(count, generator):
        transitions = torch.randn(count, 4, generator=generator)
        return transitions, project(transitions[:, :LATENT])

    kept = {}
    for weight in (0.0, 1.0):
        ase = make_ase(encoder_learning_rate=3e-3, labelled_encoder_weight=weight)
        ase.labelled = labelled
        ase.fit_encoder(100, batch=256)
        for _ in range(60):
            ase.compute_returns(fill(ase))
            ase.update()
        transitions, z = labelled(500, torch.Generator().manual_seed(5))
        kept[weight] = float(
            (ase.encoder(ase.normalizer(transitions)) * z).sum(dim=-1).mean().detach()
        )
    assert kept[1.0] > kept[0.0] + 0.05


def test_a_rollout_too_small_for_its_share_is_remembered_all_the_same(make_ase):
    """An empty memory has nothing to replay."""
    ase = make_ase(updates=1, batch=16, replay_share=1e-6)
    ase.compute_returns(fill(ase, frames=lambda step: torch.zeros(WORLDS, 2)))
    ase.update()
    assert ase.replay.size == 1


def shared(make_ase, **options):
    gan = GanConfig(hidden=(16, 8), activation="relu", encoder_shares=True, max_accuracy=1.0)
    return make_ase(discriminator="gan", gan=gan, **options)


def test_discriminator_and_encoder_share_their_hidden_layers(make_ase):
    ase = shared(make_ase)
    trunk = ase.discriminator.mlp[0].weight
    assert ase.encoder.mlp[0].weight is trunk and ase.encoder.mlp[2] is ase.discriminator.mlp[2]
    assert ase.encoder(torch.randn(5, 4)).shape == (5, LATENT)
    before, head = trunk.detach().clone(), ase.discriminator.mlp[-1].weight.detach().clone()
    ase._update_encoder(torch.randn(8, 4), project(torch.randn(8, LATENT)))
    assert not torch.equal(trunk, before), "the encoder's loss trains the shared layers"
    assert torch.equal(ase.discriminator.mlp[-1].weight, head), "but not the other's last layer"


def test_a_checkpoint_restores_layers_that_are_shared(make_ase):
    first, second = shared(make_ase), shared(make_ase, seed=1)
    first.compute_returns(fill(first))
    first.update()
    second.load(copy.deepcopy(first.save()))
    rows = torch.randn(6, 4)
    assert torch.equal(first.encoder(rows), second.encoder(rows))
    assert torch.equal(first.discriminator.mlp(rows), second.discriminator.mlp(rows))
    assert second.encoder.mlp[0].weight is second.discriminator.mlp[0].weight


def test_drail_has_no_layers_to_share(make_ase):
    ase = make_ase(discriminator="drail", gan=GanConfig(encoder_shares=True), encoder_hidden=(6,))
    assert ase.encoder.mlp[0].out_features == 6
