import numpy as np
import pytest
import torch

from lacoloco.datasets.clip import Clip
from lacoloco.datasets.motion_library import MotionLibrary
from lacoloco.datasets.published import resolve
from lacoloco.pipelines.evaluation.skill_cells import SkillCells
from lacoloco.pipelines.evaluation.skill_coverage import SkillCoverage
from lacoloco.pipelines.exploring.clip_names import ClipNames, clips_at_hand
from lacoloco.pipelines.exploring.latent_map import HeldLatents, LatentMap, extremes, hold_sampled
from lacoloco.pipelines.policies import load_policies
from lacoloco.pipelines.sim.state import RobotState, style_frame

CELLS = SkillCells(walk_speed=0.15, turn_speed=0.4, reach_height=0.1)


@pytest.fixture
def held():
    """Latents of which the third number is a forward velocity, and the fifth a lift."""
    latents = np.random.default_rng(0).normal(size=(200, 6))
    latents /= np.linalg.norm(latents, axis=1, keepdims=True)
    motion = np.zeros((200, 4))
    motion[:, 0], motion[:, 3] = latents[:, 2], latents[:, 4]
    speed, fell = np.abs(motion[:, 0]), np.zeros(200, dtype=bool)
    return HeldLatents(latents, motion, speed, fell, {}, np.zeros((200, 19)))


def test_the_map_shows_the_directions_along_which_the_motion_differs(held):
    axes = LatentMap(held).axes
    assert axes.T @ axes == pytest.approx(np.eye(2), abs=1e-9)
    plane = np.eye(6)[:, [2, 4]]
    cosines = np.linalg.svd(axes.T @ plane)[1]
    assert cosines.min() > 0.95  # the rest is chance: 200 latents are not exactly uniform


def test_a_point_of_the_map_is_a_latent_and_back(held):
    shown, now = LatentMap(held), held.latents[7]
    assert shown.latent_at(shown.place(now), now) == pytest.approx(now)
    for point in (np.array([0.3, -0.5]), np.array([0.0, 0.0])):
        latent = shown.latent_at(point, now)
        assert np.linalg.norm(latent) == pytest.approx(1.0)
        assert shown.place(latent) == pytest.approx(point)
    outside = shown.latent_at(np.array([3.0, 4.0]), now)
    assert shown.place(outside) == pytest.approx([0.6, 0.8])
    inwards = shown.latent_at(np.array([0.1, 0.0]), outside)  # nothing says in which direction
    assert shown.place(inwards) == pytest.approx([0.1, 0.0])
    assert shown.nearest(shown.points[5] + 0.001, within=0.01) == 5
    assert shown.nearest(np.array([5.0, 5.0]), within=0.01) is None


def test_who_does_what_most_leaves_out_those_that_fell_and_what_counts_as_standing():
    motion = np.array(
        [[0.5, 0, 0, 0], [0.9, 0, 0, 0], [-0.1, 0, 0, 0], [0, 0, -0.6, 0.0], [0, 0.2, 0, 0.3]]
    )
    fell = np.array([False, True, False, False, False])
    speed = np.linalg.norm(motion[:, :2], axis=1)
    found = extremes(HeldLatents(np.eye(5), motion, speed, fell, {}, np.zeros((5, 19))), CELLS)
    assert [(one.name, one.index, one.value) for one in found] == [
        ("fastest forward", 0, 0.5),
        ("fastest to the left", 4, 0.2),
        ("turns right most", 3, -0.6),
        ("reaches highest", 4, 0.3),
        ("stands stillest", 2, 0.1),
    ]


def test_latents_are_held_as_for_the_skill_coverage(solo12, motions):
    low = load_policies(resolve("solo12-synthetic-low"), "low")[1]["low"]
    held = hold_sampled(solo12, low, 6, seed=2)
    measured = SkillCoverage(solo12, motions, latents=6, seed=2).measure(low)
    assert held.shares == {name: measured[f"coverage_{name}"] for name in held.shares}
    assert held.speed[~held.fell].mean() == pytest.approx(measured["coverage_speed"], abs=1e-6)


def test_the_nearest_clip_is_the_one_that_is_played(solo12, make_clips):
    pose = np.tile(solo12.default_qpos(), (50, 1))
    parts = pose[:, :3], pose[:, 3:7], pose[:, 7:]
    still = Clip.from_poses("still", 50.0, solo12.joint_names, *parts)
    clips = [make_clips(solo12)[0], still]
    names, library = ClipNames(clips), MotionLibrary(clips)
    for index, name in enumerate(("clip_0 (walk)", "still")):
        frames = library.frames(torch.full((20,), index), torch.linspace(0.1, 0.9, 20))
        shown = names.nearest(style_frame(RobotState.from_motion(frames)).numpy())
        assert shown.startswith(name)


def test_clips_that_are_gone_are_not_asked_for():
    assert clips_at_hand(resolve("solo12-synthetic-low"), [], "solo12") == []
