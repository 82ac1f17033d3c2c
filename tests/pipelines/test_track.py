"""Clips performed by a robot that follows them."""

from copy import deepcopy
from dataclasses import replace

import numpy as np
import pytest
import torch

from lacoloco.datasets.clip import load_clips, save_clips
from lacoloco.datasets.motion_library import MotionLibrary
from lacoloco.datasets.store import RunStore
from lacoloco.pipelines import track
from lacoloco.pipelines.stage import StageContext
from lacoloco.pipelines.tracking.config import RecordingConfig, TrackerConfig
from lacoloco.pipelines.tracking.env import NEVER, TrackingEnv
from lacoloco.pipelines.tracking.reference_clips import reference_clips
from lacoloco.pipelines.tracking.reference_motion import LOOKAHEAD, ReferenceMotion
from lacoloco.pipelines.tracking.rollout_plan import num_rollouts, plan_rollouts
from lacoloco.pipelines.tracking.segments import cut_rests, split_at_terminations
from lacoloco.pipelines.tracking.trainer import TrackerTrainer


@pytest.fixture
def library(solo12, make_clips):
    return MotionLibrary(reference_clips(solo12, make_clips(solo12), (1.0,)))


@pytest.fixture
def env(solo12, library):
    config = replace(track.smoke().tracker, standing_start_fraction=0.0, stop_fraction=0.0)
    env = TrackingEnv(
        solo12, library, ReferenceMotion(solo12, library), config, 16, seed=0, device="cpu"
    )
    env.reset(torch.ones(16, dtype=torch.bool))
    return env


def test_being_where_the_clip_is_pays_most(env):
    here, terminated = env.reference.compare(env.base.state, env.rows)
    assert torch.allclose(here, torch.ones(16), atol=1e-3)
    assert not terminated.any()
    elsewhere, _ = env.reference.compare(env.base.state, (env.rows + 10).clamp_max(59))
    assert (elsewhere < here).all()


def test_a_heading_and_a_place_are_not_asked_for(env):
    state = env.base.state
    half_turn = state.root_quat[:, [3, 2, 1, 0]] * torch.tensor([-1.0, -1.0, 1.0, 1.0])
    turned = replace(
        state, root_pos=state.root_pos + torch.tensor([3.0, 1.0, 0.0]), root_quat=half_turn
    )
    reward, _ = env.reference.compare(turned, env.rows)
    assert torch.allclose(reward, torch.ones(16), atol=1e-3)


@pytest.mark.parametrize("change", ["joints", "height", "tilt"])
def test_a_large_error_terminates(env, change):
    state = env.base.state
    changed = {
        "joints": replace(state, joint_pos=state.joint_pos + 0.6),
        "height": replace(state, root_pos=state.root_pos + torch.tensor([0.0, 0.0, 0.1])),
        "tilt": replace(state, root_quat=torch.tensor([[0.9, 0.436, 0.0, 0.0]]).expand(16, 4)),
    }
    assert env.reference.compare(changed[change], env.rows)[1].all()


def test_it_sees_what_comes_next(env):
    rows = torch.tensor([5, 58])
    ahead = env.reference.lookahead(rows).view(2, len(LOOKAHEAD), -1)
    assert torch.equal(ahead[0], env.reference.frames[5 + torch.tensor(LOOKAHEAD)])
    assert torch.equal(ahead[1], env.reference.frames[[59, 59, 59]]), (
        "a clip does not lead into the next"
    )


def test_a_step_leads_to_the_next_moment_and_a_clip_ends(env):
    env.reset_to(
        torch.ones(16, dtype=torch.bool), torch.full((16,), 57), torch.zeros(16, dtype=torch.bool)
    )
    _, _, terminated, ended = env.step(torch.zeros(16, 12))
    assert (env.rows == 58).all() and not ended.any()
    _, _, terminated, ended = env.step(torch.zeros(16, 12))
    assert (ended | terminated).all()


def test_a_standing_start_has_time_before_early_termination(solo12, library):
    config = TrackerConfig(worlds=16, standing_start_fraction=1.0, grace_s=0.04)
    env = TrackingEnv(
        solo12, library, ReferenceMotion(solo12, library), config, 16, seed=0, device="cpu"
    )
    env.reset(torch.ones(16, dtype=torch.bool))
    assert float(env.base.state.joint_vel.abs().max()) == 0.0
    crouched = env.base.state.root_pos - torch.tensor([0.0, 0.0, 0.1])
    real = env.base._read

    def read():
        real()
        env.base.state = replace(env.base.state, root_pos=crouched)

    env.base._read = read
    outcomes = [bool(env.step(torch.zeros(16, 12))[2].all()) for _ in range(3)]
    assert outcomes == [False, False, True]


def test_it_learns_and_goes_on_where_it_was(solo12, library):
    config = track.smoke().tracker
    trainer = TrackerTrainer(solo12, library, config, seed=0, device="cpu")
    trainer.iterate(0.0)
    kept = deepcopy(trainer.state_dict())
    other = TrackerTrainer(solo12, library, config, seed=0, device="cpu")
    generator = torch.get_rng_state()
    metrics = trainer.iterate(0.5)
    torch.set_rng_state(generator)
    other.load_state_dict(kept)
    assert metrics == other.iterate(0.5)


@pytest.mark.parametrize(
    ("terminated", "standing", "expected"),
    [
        ([], True, [(0, 101)]),
        ([], False, [(10, 101)]),
        ([60], False, [(10, 41), (71, 101)]),
        ([60], True, [(0, 41), (71, 101)]),
        ([20], True, [(31, 101)]),
        ([60, 70], True, [(0, 41), (81, 101)]),
    ],
)
def test_what_leads_to_an_early_termination_is_cut_out(terminated, standing, expected):
    config = RecordingConfig(transient_s=0.2, before_termination_s=0.4, min_segment_s=0.2)
    at = torch.zeros(100, dtype=torch.bool)
    at[terminated] = True
    assert list(split_at_terminations(at, standing, config)) == expected


@pytest.mark.parametrize(
    ("resting", "expected"),
    [
        ([], [(10, 100)]),
        ([(30, 50)], [(10, 100)]),
        ([(30, 70)], [(10, 40), (60, 100)]),
        ([(0, 70)], [(10, 20), (60, 100)]),
        ([(0, 200)], [(10, 20), (90, 100)]),
        ([(15, 40), (50, 90)], [(10, 25), (30, 60), (80, 100)]),
    ],
)
def test_of_a_stillness_only_its_ends_are_kept(resting, expected):
    config = RecordingConfig(rest_s=0.2, min_segment_s=0.1)
    still = np.zeros(200, dtype=bool)
    for start, stop in resting:
        still[start:stop] = True
    assert list(cut_rests(still, (10, 100), config)) == expected


def test_all_standing_starts_swing_the_same_way(env):
    config = RecordingConfig(copies=2, starts=5, stops=0, min_segment_s=0.05)
    plan = plan_rollouts(env, config, seed=0)
    assert num_rollouts(3, config) == len(plan.rows) == 9
    assert plan.rows[:4].tolist() == [0, 60, 0, 60] and plan.steps[:4].tolist() == [59] * 4
    assert plan.standing.tolist() == [False] * 4 + [True] * 5
    assert (plan.stop_at == NEVER).all()
    velocity = env.reference.states.qvel[plan.rows[4:], 6:]
    assert (velocity @ velocity.T > 0.0).all()
    assert (plan.rows + plan.steps <= env.reference.states.last[plan.rows]).all()


def test_a_stop_leaves_the_clip_for_standing_and_gives_time(env):
    everyone, still = torch.ones(16, dtype=torch.bool), torch.zeros(16, 12)
    env.reset_to(everyone, torch.full((16,), 20), ~everyone)
    env.stop_at[:8] = 2
    env.step(still)
    assert (env.rows == 21).all()
    env.step(still)
    assert (env.rows[:8] == env.reference.states.first[-1]).all() and (env.rows[8:] == 22).all()
    assert (env.grace_until[:8] > 2).all() and (env.grace_until[8:] == 0).all()
    env.reset_to(everyone, env.rows, ~everyone)
    assert (env.stop_at == NEVER).all(), "who was put elsewhere does not stop there"


def test_a_share_of_the_episodes_stops(solo12, library):
    config = replace(
        track.smoke().tracker,
        standing_start_fraction=0.5,
        stop_fraction=0.5,
        stop_after_s=(0.1, 0.2),
    )
    env = TrackingEnv(
        solo12, library, ReferenceMotion(solo12, library), config, 256, seed=0, device="cpu"
    )
    env.reset(torch.ones(256, dtype=torch.bool))
    stops = env.stop_at != NEVER
    assert 0.18 < float(stops.float().mean()) < 0.32 and not (stops & (env.grace_until > 0)).any()
    assert env.stop_at[stops].min() >= 5 and env.stop_at[stops].max() < 10


def test_stops_are_planned_before_their_clips_end(env, solo12):
    config = RecordingConfig(
        copies=1, starts=0, stops=50, stop_after_s=(0.2, 5.0), min_segment_s=0.1, stand_s=0.4
    )
    plan = plan_rollouts(env, config, seed=0)
    assert num_rollouts(3, config) == len(plan.rows) == 52
    rows, stop_at = plan.rows[2:], plan.stop_at[2:]
    assert (plan.stop_at[:2] == NEVER).all() and not plan.standing.any()
    assert (stop_at >= 1).all() and (rows + stop_at < env.reference.states.last[rows]).all()
    assert (plan.steps[2:] == stop_at + 20).all()
    assert (env.reference.speed[rows] > solo12.tracking.moving_speed).all()


def test_the_reference_clips_are_the_clips_at_every_speed_and_standing(solo12, make_clips):
    clips = make_clips(solo12)
    made = reference_clips(solo12, clips, (1.0, 0.5))
    assert [clip.name for clip in made] == [
        "clip_0",
        "clip_1",
        "clip_0_speed0.5",
        "clip_1_speed0.5",
        "standing",
    ]
    assert made[2].duration == pytest.approx(2.0 * clips[0].duration)
    assert np.allclose(made[2].joint_vel, 0.5 * clips[0].joint_vel) and np.array_equal(
        made[2].joint_pos, clips[0].joint_pos
    )
    still = made[-1]
    assert not still.joint_vel.any() and np.allclose(still.joint_pos, solo12.default_joint_pos)


def test_the_stage_leaves_clips_and_the_tracker(solo12, library, make_clips, tmp_path):
    context = StageContext(RunStore(tmp_path / "runs"), "r")
    source = save_clips(
        tmp_path / "clips.h5",
        make_clips(solo12),
        robot=(solo12.name, solo12.model_hash()),
        config={},
        seed=0,
        parents=[],
        command="",
    )
    result = track.run(track.smoke(), context, motions=[source])
    segments = load_clips(result.artifact, robot="solo12")
    assert len(segments) == result.metrics["segments"] >= 1
    assert {segment.skill for segment in segments} == {clip.skill for clip in make_clips(solo12)}
    assert all(segment.fps == 50.0 and np.isfinite(segment.joint_vel).all() for segment in segments)
    assert (result.artifact.parent / "tracker.h5").exists()
    assert not list(result.artifact.parent.glob("*.checkpoint.h5"))
