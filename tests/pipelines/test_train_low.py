"""Low-level training: what reaches the discriminator, and what the stage leaves."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from lacoloco.datasets.clip import save_clips
from lacoloco.datasets.motion_library import MotionLibrary
from lacoloco.pipelines import train_low
from lacoloco.pipelines.errors import StageError
from lacoloco.pipelines.learn.ppo import PpoConfig
from lacoloco.pipelines.low_level.trainer import LowTrainer
from lacoloco.pipelines.robot import record_of
from lacoloco.pipelines.train_low import load_motions, smoke

JOINTS = slice(10, 22)
SPEEDS = slice(22, 34)


@pytest.fixture
def make_trainer(solo12, motions):
    def factory(horizon=8, **changes):
        config = replace(
            smoke(), ppo=PpoConfig(horizon=horizon, epochs=1, minibatches=1), **changes
        )
        return LowTrainer(solo12, motions, config, seed=0, device="cpu")

    return factory


def halves(transitions):
    return transitions[..., :34], transitions[..., 34:]


def sign_relation(transitions):
    """Correlation of how far the joints move in a transition with how fast they say they do."""
    before, after = halves(transitions)
    moved = (after - before)[..., JOINTS].flatten()
    speed = 0.5 * (before + after)[..., SPEEDS].flatten()
    return float(torch.corrcoef(torch.stack([moved, speed]))[0, 1])


def test_a_cloned_actor_keeps_its_statistics_and_another_learns_them(make_trainer):
    for steps in (4, 0):
        trainer = make_trainer(bc_steps=steps)
        if steps:
            trainer.pretrain()
        actor, critic = trainer.algorithm.actor, trainer.algorithm.critic
        before = [net.obs_normalizer.count.clone() for net in (actor, critic)]
        trainer.iterate(0.0)
        moved = [
            bool(net.obs_normalizer.count > count)
            for net, count in zip((actor, critic), before, strict=True)
        ]
        assert moved == [steps == 0, True]


def test_a_robot_with_a_gait_asks_its_experts_and_others_do_not(h1, solo12, make_clips):
    laptop, silent = train_low.laptop(), make_clips(h1)
    spoken = [replace(clip, command=np.zeros((clip.frames, 3))) for clip in silent]
    assert train_low.expert_rounds(laptop, spoken, h1) == train_low.ROUNDS_OF_A_GAIT
    assert train_low.expert_rounds(laptop, silent, h1) == 0
    assert train_low.expert_rounds(replace(laptop, bc_steps=0), spoken, h1) == 0
    assert train_low.expert_rounds(laptop, spoken, solo12) == 0
    assert train_low.expert_rounds(replace(laptop, expert_rounds=2), silent, solo12) == 2


def test_demonstrations_and_agent_share_one_direction_of_time(make_trainer):
    """Bug B1: in the original one runs backwards, which a discriminator can always tell."""
    trainer = make_trainer()
    trainer.iterate(0.0)
    assert sign_relation(trainer.algorithm.transitions) > 0.5
    assert sign_relation(trainer.demonstrations(2000)) > 0.5


def test_demonstrations_are_a_control_step_apart(make_trainer):
    """Both frames of one clip: joints move by their speed times 20 ms."""
    before, after = halves(make_trainer().demonstrations(500))
    moved = (after - before)[:, JOINTS]
    expected = 0.02 * 0.5 * (before + after)[:, SPEEDS]
    assert torch.allclose(moved, expected, atol=1e-3)
    assert float(moved.abs().max()) > 0.01


def test_the_transition_of_a_fall_ends_in_the_fall(make_trainer):
    """Bug B2: the original's ends in the state after the reset, often a frame of a clip."""
    trainer = make_trainer(horizon=2)
    env = trainer.env
    qpos, qvel = env.physics.qpos[[0]].clone(), torch.zeros(1, 18)
    qpos[:, 2], qpos[:, 3:7] = 0.05, torch.tensor([0.0, 1.0, 0.0, 0.0])
    qvel[:, 2] = -2.0
    env.physics.reset(torch.tensor([0]), qpos, qvel)
    env._read()
    trainer.iterate(0.0)
    first, second = trainer.algorithm.transitions[:2, 0]
    assert trainer.algorithm.done[0, 0]
    assert halves(first)[1][3] > 0.9, "on its back at the end of the fall"
    assert halves(second)[0][3] < -0.5, "upright at the start of the next episode"


def test_transitions_begin_where_the_one_before_ended_or_in_a_new_episode(make_trainer):
    """Bug B4: half of the original's resets give (s_t, s_t), some with another world's gravity."""
    trainer = make_trainer(horizon=4)
    trainer.env.steps.fill_(0)
    trainer.env.steps[::2] = trainer.env.episode_steps[::2] - 2
    trainer.env._push_at.fill_(1000)  # a push is between two transitions
    trainer.iterate(0.0)
    before, after = halves(trainer.algorithm.transitions)
    going_on = ~trainer.algorithm.done[:-1]
    assert going_on.any()
    assert not going_on.all()
    assert torch.equal(after[:-1][going_on], before[1:][going_on])
    assert not (after[:-1] == before[1:]).all(dim=-1)[~going_on].any()
    assert not (before == after).all(dim=-1).any()
    # Every new episode starts upright, so its gravity is its own.
    assert (before[1:][~going_on][:, 3] < -0.9).all()


def test_long_horizon_worlds_live_as_under_a_high_level(make_trainer):
    trainer = make_trainer(long_horizon_fraction=0.25, long_horizon_from=0.5, randomisation=1.5)
    env, long_horizon = trainer.env, torch.arange(16) < 4
    trainer.iterate(0.49)
    assert (env.episode_steps == 100).all()
    assert not trainer.latents.random_walk.any()
    trainer.iterate(0.5)
    assert (env.episode_steps[long_horizon] == 500).all()
    assert (env.episode_steps[~long_horizon] == 100).all()
    assert not env.clip_share[long_horizon].any()
    assert torch.equal(trainer.latents.random_walk, long_horizon)
    assert env.task.randomisation.mass_scale == pytest.approx((0.7, 1.3))


def test_what_the_discriminator_sees_is_clean(make_trainer):
    """The policy's copy of the frame carries noise, the transition's does not."""
    trainer = make_trainer(horizon=1)
    frame = trainer.env.frame()
    trainer.iterate(0.0)
    assert torch.equal(halves(trainer.algorithm.transitions[0])[0], frame)
    seen = trainer.algorithm.storage.observations["policy"][0]
    assert not torch.allclose(seen[:, :34], frame, atol=1e-3)


@pytest.mark.parametrize(("progress", "expected"), [(0.0, 0.0), (0.5, 0.1), (1.0, 0.2)])
def test_constraints_rise_with_the_progress_and_reach_the_learner(
    make_trainer, monkeypatch, progress, expected
):
    trainer = make_trainer(cat_ramp=(0.0, 1.0))
    step, violations = trainer.env.step, {"foot_force": torch.full((16, 4), 3.0)}
    monkeypatch.setattr(trainer.env, "step", lambda a: replace(step(a), violations=violations))
    metrics = trainer.iterate(progress)
    assert torch.allclose(trainer.algorithm.delta, torch.tensor(expected))
    assert metrics["delta"] == pytest.approx(expected)


def test_each_constraint_is_reported_over_the_whole_rollout(make_trainer, monkeypatch):
    """Half of the steps have one foot of four above its limit, by up to 3 N."""
    trainer = make_trainer(horizon=4)
    step, count = trainer.env.step, iter(range(4))

    def scripted(action):
        margin = torch.full((16, 4), -1.0)
        margin[:, 0] = 3.0 if next(count) % 2 else -1.0
        return replace(step(action), violations={"foot_force": margin})

    monkeypatch.setattr(trainer.env, "step", scripted)
    metrics = trainer.iterate(0.0)
    assert metrics["violation_foot_force"] == pytest.approx(0.125)
    assert 0.0 < metrics["c_max_foot_force"] <= 3.0


def test_what_a_person_watches_is_reported(make_trainer):
    expected = {
        "margin",
        "diversity",
        "kl",
        "learning_rate",
        "explained_variance",
        "value",
        "delta",
    }
    metrics = make_trainer().iterate(0.5)
    assert expected <= set(metrics)
    assert 0.5 < metrics["diversity"] < 1.5, "an untrained actor hardly depends on the latent"


def test_without_constraints_nothing_is_terminated_softly(make_trainer):
    trainer = make_trainer(cat=False)
    assert trainer.iterate(1.0)["delta"] == 0.0
    assert not trainer.algorithm.delta.any()


def test_the_exploration_noise_is_the_config_s(make_trainer):
    trainer = make_trainer(exploration_std=0.2)
    for progress in (0.0, 1.0):
        assert trainer.iterate(progress)["std"] == pytest.approx(0.2)
        std = trainer.algorithm.actor.distribution.log_std_param.exp()
        assert torch.allclose(std, torch.tensor(0.2))


def test_a_new_episode_has_a_new_latent_and_its_last_state_the_old_one(make_trainer, monkeypatch):
    trainer = make_trainer(horizon=1)
    trainer.env.steps = trainer.env.episode_steps - 1
    trainer.latents.remaining.fill_(100)
    before, seen = trainer.latents.z, {}
    record = trainer.algorithm.record

    def watched(reward, fell, timed_out, next_obs, delta):
        seen.update(timed_out=timed_out, latent=next_obs["latent"])
        record(reward, fell, timed_out, next_obs, delta)

    monkeypatch.setattr(trainer.algorithm, "record", watched)
    trainer.iterate(0.0)
    assert seen["timed_out"].all()
    assert torch.equal(seen["latent"], before)
    assert not (trainer.latents.z == before).all(dim=-1).any()
    assert not trainer.env.steps.any()


def test_closing_metrics_compare_with_the_clips(make_trainer):
    trainer = make_trainer()
    trainer.recent_falls = [5.0] * 199 + [2.0]
    metrics = trainer.closing_metrics()
    assert metrics["falls_last_1pct"] == 7.0
    assert metrics["clip_speed"] == pytest.approx(0.4, abs=0.01)
    assert metrics["diverged_worlds"] == 0.0


def test_the_last_metrics_are_of_the_policy_that_is_kept(make_trainer):
    """Warnings and the artifact's metrics come from them."""
    trainer = make_trainer()
    trainer.selection.confirm = lambda actor: {"score": 0.3, "chosen_after": 640.0}
    trainer.selection.examine = lambda actor, samples: {"score": 0.9}
    metrics = trainer.iterate(1.0 - 1.0 / trainer.iterations)
    assert (metrics["chosen_after"], metrics["score"]) == (640.0, 0.3)


def test_motions_are_needed():
    with pytest.raises(StageError, match="--motions"):
        load_motions([])


def test_motions_of_one_artifact_are_taken_as_they_are_stored(solo12, make_clips, tmp_path):
    clips = make_clips(solo12)
    files = [
        save_clips(tmp_path / f"{name}.h5", clips, robot=record_of(solo12), config={})
        for name in ("one", "other")
    ]
    alone, _ = load_motions(files[:1])
    stored = alone.flat.series["joint_pos"]
    library = MotionLibrary(alone)
    assert any(np.shares_memory(stored, rows.numpy()) for rows in library._states)
    both, spec = load_motions(files)
    assert (len(both), spec.name) == (4, "solo12")
    moments = torch.tensor([1, 3]), torch.tensor([0.3, 0.3])
    first, second = MotionLibrary(both).frames(*moments).joint_pos
    assert first.equal(second)
    assert first.equal(library.frames(moments[0][:1], moments[1][:1]).joint_pos[0])


def test_the_strides_of_the_policy_shorten_towards_the_end(make_trainer):
    trainer = make_trainer(kl_anneal=(0.1, 0.5, 1.0))
    seen = []
    for progress in (0.5, 0.75, 1.0):
        trainer.iterate(progress)
        seen.append(trainer.algorithm.desired_kl / trainer.config.ppo.desired_kl)
    assert seen == pytest.approx([1.0, 0.1**0.5, 0.1])


def test_what_is_cloned_begins_where_clips_begin_more_often_than_it_would(solo12, motions):
    trainer = LowTrainer(
        solo12, motions, replace(smoke(), bc_clip_start_fraction=0.25), seed=0, device="cpu"
    )
    rows = trainer.start.cloned(400)
    at_the_beginning = torch.isin(rows, trainer.start.clips.first).float().mean()
    assert 0.25 <= at_the_beginning < 0.3


def test_the_papers_method_learns_its_std_and_starts_where_it_was(solo12, motions):
    """Its parts together, with smaller networks: shared layers, style, learned std, c_max."""
    config = train_low.PRESETS["paper-method"]()
    gan = replace(config.ase.gan, hidden=(16, 8))
    ase = replace(config.ase, discriminator="gan", gan=gan, updates=2, batch=32)
    ppo = replace(config.ppo, horizon=8, epochs=1, minibatches=1)
    config = replace(
        config, worlds=16, samples=256, coverage_every=0, coverage_latents=16, cat_ramp=(0.0, 0.0)
    )
    config = replace(config, ase=ase, ppo=ppo, networks=replace(config.networks, actor=(8,)))
    first, second = (
        LowTrainer(solo12, motions, config, seed=seed, device="cpu") for seed in (0, 1)
    )
    begin = first.iterate(0.0)["std"]
    assert begin == pytest.approx(0.055, rel=0.01) and begin != config.networks.init_std
    second.load_state_dict(first.state_dict())
    assert torch.equal(
        second.terminations.c_max["foot_force"],
        first.terminations.c_max["foot_force"],
    )
    policies = [trainer.algorithm.actor.state_dict() for trainer in (first, second)]
    assert all(torch.equal(value, policies[1][name]) for name, value in policies[0].items())
