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
from lacoloco.pipelines.tracking import recorder as performances
from lacoloco.pipelines.tracking.reference_clips import repertoire
from lacoloco.pipelines.tracking.reference_motion import AHEAD, References
from lacoloco.pipelines.tracking.trainer import NEVER, Shadow, TrackerConfig, TrackerTrainer


@pytest.fixture
def library(solo12, make_clips):
    return MotionLibrary(repertoire(solo12, make_clips(solo12), (1.0,)))


@pytest.fixture
def shadow(solo12, library):
    config = replace(track.smoke().tracker, standing=0.0, stopping=0.0)
    shadow = Shadow(solo12, library, References(solo12, library), config, 16, seed=0, device="cpu")
    shadow.begin(torch.ones(16, dtype=torch.bool))
    return shadow


def test_being_where_the_clip_is_pays_most(shadow):
    here, lost = shadow.references.compare(shadow.env.state, shadow.rows)
    assert torch.allclose(here, torch.ones(16), atol=1e-3)
    assert not lost.any()
    elsewhere, _ = shadow.references.compare(shadow.env.state, (shadow.rows + 10).clamp_max(59))
    assert (elsewhere < here).all()


def test_a_heading_and_a_place_are_not_asked_for(shadow):
    state = shadow.env.state
    half_turn = state.root_quat[:, [3, 2, 1, 0]] * torch.tensor([-1.0, -1.0, 1.0, 1.0])
    turned = replace(
        state, root_pos=state.root_pos + torch.tensor([3.0, 1.0, 0.0]), root_quat=half_turn
    )
    reward, _ = shadow.references.compare(turned, shadow.rows)
    assert torch.allclose(reward, torch.ones(16), atol=1e-3)


@pytest.mark.parametrize("change", ["joints", "height", "tilt"])
def test_what_is_hopeless_is_lost(shadow, change):
    state = shadow.env.state
    changed = {
        "joints": replace(state, joint_pos=state.joint_pos + 0.6),
        "height": replace(state, root_pos=state.root_pos + torch.tensor([0.0, 0.0, 0.1])),
        "tilt": replace(state, root_quat=torch.tensor([[0.9, 0.436, 0.0, 0.0]]).expand(16, 4)),
    }
    assert shadow.references.compare(changed[change], shadow.rows)[1].all()


def test_it_sees_what_comes_next(shadow):
    rows = torch.tensor([5, 58])
    ahead = shadow.references.ahead(rows).view(2, len(AHEAD), -1)
    assert torch.equal(ahead[0], shadow.references.frames[5 + torch.tensor(AHEAD)])
    assert torch.equal(ahead[1], shadow.references.frames[[59, 59, 59]]), (
        "a clip does not lead into the next"
    )


def test_a_step_leads_to_the_next_moment_and_a_clip_ends(shadow):
    shadow.put(
        torch.ones(16, dtype=torch.bool), torch.full((16,), 57), torch.zeros(16, dtype=torch.bool)
    )
    _, _, lost, ended = shadow.step(torch.zeros(16, 12))
    assert (shadow.rows == 58).all() and not ended.any()
    _, _, lost, ended = shadow.step(torch.zeros(16, 12))
    assert (ended | lost).all()


def test_who_begins_standing_may_take_its_time(solo12, library):
    config = TrackerConfig(worlds=16, standing=1.0, grace_s=0.04)
    shadow = Shadow(solo12, library, References(solo12, library), config, 16, seed=0, device="cpu")
    shadow.begin(torch.ones(16, dtype=torch.bool))
    assert float(shadow.env.state.joint_vel.abs().max()) == 0.0
    crouched = shadow.env.state.root_pos - torch.tensor([0.0, 0.0, 0.1])
    real = shadow.env._read

    def read():
        real()
        shadow.env.state = replace(shadow.env.state, root_pos=crouched)

    shadow.env._read = read
    outcomes = [bool(shadow.step(torch.zeros(16, 12))[2].all()) for _ in range(3)]
    assert outcomes == [False, False, True]


def test_it_learns_and_goes_on_where_it_was(solo12, library):
    config = track.smoke().tracker
    trainer = TrackerTrainer(solo12, library, config, seed=0, device="cpu")
    trainer.iterate(0.0)
    kept = deepcopy(trainer.state_dict())
    other = TrackerTrainer(solo12, library, config, seed=0, device="cpu")
    generator = torch.get_rng_state()
    figures = trainer.iterate(0.5)
    torch.set_rng_state(generator)
    other.load_state_dict(kept)
    assert figures == other.iterate(0.5)


@pytest.mark.parametrize(
    ("lost", "standing", "expected"),
    [
        ([], True, [(0, 101)]),
        ([], False, [(10, 101)]),
        ([60], False, [(10, 41), (71, 101)]),
        ([60], True, [(0, 41), (71, 101)]),
        ([20], True, [(31, 101)]),
        ([60, 70], True, [(0, 41), (81, 101)]),
    ],
)
def test_what_leads_to_a_loss_is_cut_out(lost, standing, expected):
    config = performances.RecordingConfig(settle_s=0.2, before_loss_s=0.4, shortest_s=0.2)
    at = torch.zeros(100, dtype=torch.bool)
    at[lost] = True
    assert list(performances.pieces_of(at, standing, config)) == expected


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
    config = performances.RecordingConfig(rest_s=0.2, shortest_s=0.1)
    still = np.zeros(200, dtype=bool)
    for start, stop in resting:
        still[start:stop] = True
    assert list(performances.without_rest(still, (10, 100), config)) == expected


def test_all_beginnings_swing_the_same_way(shadow):
    config = performances.RecordingConfig(copies=2, starts=5, stops=0, shortest_s=0.05)
    journey = performances.plan(shadow, config, seed=0)
    assert performances.worlds("abc", config) == len(journey.rows) == 9
    assert journey.rows[:4].tolist() == [0, 60, 0, 60] and journey.steps[:4].tolist() == [59] * 4
    assert journey.standing.tolist() == [False] * 4 + [True] * 5
    assert (journey.stop_at == NEVER).all()
    velocity = shadow.states.qvel[journey.rows[4:], 6:]
    assert (velocity @ velocity.T > 0.0).all()
    assert (journey.rows + journey.steps <= shadow.states.last[journey.rows]).all()


def test_a_stop_leaves_the_clip_for_standing_and_gives_time(shadow):
    everyone, still = torch.ones(16, dtype=torch.bool), torch.zeros(16, 12)
    shadow.put(everyone, torch.full((16,), 20), ~everyone)
    shadow.stop_at[:8] = 2
    shadow.step(still)
    assert (shadow.rows == 21).all()
    shadow.step(still)
    assert (shadow.rows[:8] == shadow.states.first[-1]).all() and (shadow.rows[8:] == 22).all()
    assert (shadow.grace[:8] > 2).all() and (shadow.grace[8:] == 0).all()
    shadow.put(everyone, shadow.rows, ~everyone)
    assert (shadow.stop_at == NEVER).all(), "who was put elsewhere does not stop there"


def test_a_share_of_the_episodes_stops(solo12, library):
    config = replace(track.smoke().tracker, standing=0.5, stopping=0.5, stop_after_s=(0.1, 0.2))
    shadow = Shadow(solo12, library, References(solo12, library), config, 256, seed=0, device="cpu")
    shadow.begin(torch.ones(256, dtype=torch.bool))
    stops = shadow.stop_at != NEVER
    assert 0.18 < float(stops.float().mean()) < 0.32 and not (stops & (shadow.grace > 0)).any()
    assert shadow.stop_at[stops].min() >= 5 and shadow.stop_at[stops].max() < 10


def test_stops_are_planned_before_their_clips_end(shadow):
    config = performances.RecordingConfig(
        copies=1, starts=0, stops=50, stop_after_s=(0.2, 5.0), shortest_s=0.1, stand_s=0.4
    )
    journey = performances.plan(shadow, config, seed=0)
    assert performances.worlds("abc", config) == len(journey.rows) == 52
    rows, stop_at = journey.rows[2:], journey.stop_at[2:]
    assert (journey.stop_at[:2] == NEVER).all() and not journey.standing.any()
    assert (stop_at >= 1).all() and (rows + stop_at < shadow.states.last[rows]).all()
    assert (journey.steps[2:] == stop_at + 20).all()
    assert (shadow.references.speed[rows] > shadow.env.spec.tracking.moving_speed).all()


def test_the_repertoire_is_the_clips_at_every_pace_and_standing(solo12, make_clips):
    clips = make_clips(solo12)
    made = repertoire(solo12, clips, (1.0, 0.5))
    assert [clip.name for clip in made] == [
        "clip_0",
        "clip_1",
        "clip_0_pace0.5",
        "clip_1_pace0.5",
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
    pieces = load_clips(result.artifact, robot="solo12")
    assert len(pieces) == result.metrics["pieces"] >= 1
    assert {piece.skill for piece in pieces} == {clip.skill for clip in make_clips(solo12)}
    assert all(piece.fps == 50.0 and np.isfinite(piece.joint_vel).all() for piece in pieces)
    assert (result.artifact.parent / "tracker.h5").exists()
    assert not list(result.artifact.parent.glob("*.checkpoint.h5"))
