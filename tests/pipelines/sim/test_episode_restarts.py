"""Episode restarts: back to where the fall was not yet decided, or to the start of an episode that
failed.
"""

from dataclasses import replace

import pytest
import torch

from lacoloco.pipelines.sim.env import LeggedEnv
from lacoloco.pipelines.sim.episode_restarts import DEPTH, PERIOD, EpisodeRestarts
from lacoloco.pipelines.sim.tasks import imitate_task, load_task

WORLDS = 3
BACK = PERIOD * DEPTH


@pytest.fixture
def env(solo12):
    return LeggedEnv(
        solo12, replace(imitate_task(solo12, constrained=False), noise=0.0), WORLDS, seed=0
    )


def live(env, restarts, steps):
    """Sway for a while, each step under its own latent; returns states, actions and latents as they
    were before every step.
    """
    seen, generator = [], torch.Generator().manual_seed(len(restarts._kept))
    for _ in range(steps):
        latent = torch.randn(WORLDS, 7, generator=generator)
        seen.append((env.physics.qpos, env.physics.qvel, env.action, latent))
        restarts.snapshot(latent)
        env.step(0.05 * torch.randn(WORLDS, 12, generator=generator))
    return seen


@pytest.mark.parametrize("more", [1, 4, 10])
def test_a_world_is_restored_to_what_it_was(env, more):
    restarts = EpisodeRestarts(env, 7, 1.0, seed=0)
    seen = live(env, restarts, BACK + more)
    again = restarts.select(torch.tensor([True, False, True]))
    assert again.tolist() == [True, False, True]
    env.reset(torch.ones(WORLDS, dtype=torch.bool))
    fresh = env.physics.qpos[1].clone()
    latent = restarts.restore(again, torch.zeros(WORLDS, 7))
    age = (
        BACK
        + more
        - next(i for i, (qpos, *_) in enumerate(seen) if torch.equal(qpos[0], env.physics.qpos[0]))
    )
    assert PERIOD * (DEPTH - 1) < age <= BACK
    qpos, qvel, action, z = seen[BACK + more - age]
    for world in (0, 2):
        assert torch.equal(env.physics.qpos[world], qpos[world])
        assert torch.equal(env.physics.qvel[world], qvel[world])
        assert torch.equal(env.state.joint_pos[world], qpos[world, 7:])
        assert torch.equal(env.action[world], action[world])
        assert torch.equal(latent[world], z[world])
    assert torch.equal(env.physics.qpos[1], fresh)
    assert not latent[1].any()


def test_a_fall_soon_after_a_reset_is_not_restarted(env):
    restarts, fell = EpisodeRestarts(env, 7, 1.0, seed=0), torch.ones(WORLDS, dtype=torch.bool)
    env.steps.fill_(BACK + 1)
    assert not restarts.select(fell).any(), "nothing is kept yet"
    live(env, restarts, BACK)
    env.steps[:] = torch.tensor([BACK, BACK + 1, BACK + 2])
    assert restarts.select(fell).tolist() == [False, True, True]
    assert not restarts.select(~fell).any()
    assert not EpisodeRestarts(env, 7, 0.0, seed=0).select(fell).any()


def test_a_world_that_falls_again_goes_back_to_the_same_place(env):
    """Not to where the first fall was already decided, and only until the retry has lived as long
    as a snapshot is old.
    """
    restarts, fell = EpisodeRestarts(env, 7, 1.0, seed=0), torch.tensor([True, False, False])
    live(env, restarts, BACK + 3)

    def fall():
        again = restarts.select(fell)
        env.reset(fell)
        restarts.restore(again, torch.zeros(WORLDS, 7))
        return again, env.physics.qpos[0].clone()

    (first, place), _ = fall(), live(env, restarts, 23)
    (second, same), _ = fall(), live(env, restarts, BACK + 1)
    (third, later) = fall()
    assert first[0] and second[0] and third[0]
    assert torch.equal(place, same)
    assert not torch.equal(place, later)


def test_a_new_episode_ends_the_restarts(env):
    restarts, everybody = EpisodeRestarts(env, 7, 1.0, seed=0), torch.ones(WORLDS, dtype=torch.bool)
    live(env, restarts, BACK + 1)
    again = restarts.select(everybody)
    env.reset(everybody)
    restarts.restore(again, torch.zeros(WORLDS, 7))
    live(env, restarts, 5)
    assert restarts.select(everybody).all()
    env.reset(everybody)  # a time-out
    restarts.restore(torch.zeros_like(everybody), torch.zeros(WORLDS, 7))
    live(env, restarts, 5)
    assert not restarts.select(everybody).any()


def test_a_target_comes_back_with_its_world(solo12):
    env = LeggedEnv(solo12, load_task(solo12, "reach"), WORLDS, seed=0)
    restarts, fell = (
        EpisodeRestarts(env, 7, 1.0, seed=0, hold=5),
        torch.tensor([False, True, False]),
    )
    target, states = env.command.clone(), []
    for _ in range(12):
        states.append(env.physics.qpos[1].clone())
        restarts.snapshot(torch.zeros(WORLDS, 7))
        for _ in range(5):
            env.step(torch.zeros(WORLDS, 12))
    again = restarts.select(fell)
    env.reset(fell)
    assert not torch.equal(env.command[1], target[1])
    restarts.restore(again, torch.zeros(WORLDS, 7))
    assert torch.equal(env.command, target)
    assert torch.equal(env.physics.qpos[1], states[2]), "1 s back: ten decisions"


@pytest.fixture
def reaching(solo12):
    return LeggedEnv(solo12, load_task(solo12, "reach"), WORLDS, seed=0)


def miss(env, restarts, missed):
    """End the episodes of ``missed`` at a time-out; returns who begins the same one again."""
    mask = torch.tensor(missed)
    again = restarts.select(torch.zeros(WORLDS, dtype=torch.bool), mask)
    env.reset(mask)
    restarts.restore(again, torch.zeros(WORLDS, 7))
    return again.tolist()


def test_a_failed_episode_is_replayed_from_its_start(reaching):
    env, restarts = reaching, EpisodeRestarts(reaching, 7, 1.0, seed=0)
    live(env, restarts, BACK)
    assert miss(env, restarts, [True] * WORLDS) == [False] * WORLDS, "nobody knows how these began"
    start, target = env.physics.qpos.clone(), env.command.clone()
    for _ in range(2):
        live(env, restarts, BACK + 5)
        assert miss(env, restarts, [True, False, True]) == [True, False, True]
        for world in (0, 2):
            assert torch.equal(env.physics.qpos[world], start[world])
            assert torch.equal(env.command[world], target[world])
            assert env.steps[world] == 0
        assert not torch.equal(env.physics.qpos[1], start[1]), "it goes on"
    assert restarts.restarted.tolist() == [True, False, True]


def test_a_retry_after_a_fall_is_no_beginning(reaching):
    """A world that fell, was restored and failed in the end starts where its episode did, not
    where it was restored to.
    """
    env, restarts, fell = (
        reaching,
        EpisodeRestarts(reaching, 7, 1.0, seed=0),
        torch.tensor([True, False, False]),
    )
    live(env, restarts, BACK)
    miss(env, restarts, [True] * WORLDS)
    start = env.physics.qpos[0].clone()
    live(env, restarts, BACK + 3)
    again = restarts.select(fell)
    env.reset(fell)
    restarts.restore(again, torch.zeros(WORLDS, 7))
    live(env, restarts, 9)
    assert miss(env, restarts, [True, False, False])[0]
    assert torch.equal(env.physics.qpos[0], start)


def test_misses_are_bygones_where_nobody_asks(reaching):
    restarts, nobody = (
        EpisodeRestarts(reaching, 7, 1.0, seed=0),
        torch.zeros(WORLDS, dtype=torch.bool),
    )
    live(reaching, restarts, BACK)
    miss(reaching, restarts, [True] * WORLDS)
    live(reaching, restarts, 5)
    assert not restarts.select(nobody).any()
    assert not restarts.select(nobody, nobody).any()


def test_snapshots_go_on_where_they_stopped(env):
    first, second = EpisodeRestarts(env, 7, 0.5, seed=0), EpisodeRestarts(env, 7, 0.5, seed=9)
    live(env, first, BACK + 3)
    miss(env, first, [False, False, True])
    second.load_state_dict(first.state_dict())
    fell = torch.ones(WORLDS, dtype=torch.bool)
    for ends in ((fell, None), (~fell, fell)):
        chosen = [
            [restarts.select(*ends).tolist() for _ in range(9)] for restarts in (first, second)
        ]
        assert chosen[0] == chosen[1]
    again = torch.tensor([True, True, False])
    latents = [restarts.restore(again, torch.zeros(WORLDS, 7)) for restarts in (first, second)]
    assert torch.equal(*latents)


def test_snapshots_of_a_version_without_episode_starts_are_left_out(env):
    first, second = EpisodeRestarts(env, 7, 1.0, seed=0), EpisodeRestarts(env, 7, 1.0, seed=9)
    live(env, first, BACK + 3)
    state = first.state_dict()
    del state["start_known"]
    second.load_state_dict(state)
    assert not second.select(torch.ones(WORLDS, dtype=torch.bool)).any()


def test_snapshots_of_many_worlds_stay_out_of_checkpoints(env, monkeypatch):
    monkeypatch.setattr("lacoloco.pipelines.sim.episode_restarts.STATE_BYTES", 100)
    first, second = EpisodeRestarts(env, 7, 1.0, seed=0), EpisodeRestarts(env, 7, 1.0, seed=9)
    live(env, first, BACK + 3)
    state = first.state_dict()
    assert set(state) == {"count", "generator"}
    second.load_state_dict(state)
    assert not second.select(torch.ones(WORLDS, dtype=torch.bool)).any(), "it begins without any"
