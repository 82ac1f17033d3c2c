from dataclasses import fields, replace

import numpy as np
import pytest
import torch

from lacoloco.datasets import rotations
from lacoloco.datasets.errors import DatasetError
from lacoloco.datasets.motion_library import Emphasis, MotionLibrary

DT = 0.02


@pytest.fixture
def generator():
    return torch.Generator().manual_seed(0)


def at(library, clip, time):
    return library.frames(torch.tensor([clip]), torch.tensor([time]))


def test_frames_at_frame_times_are_the_frames(make_clip):
    clips = [make_clip("a", frames=40), make_clip("b", frames=25, fps=60, speed=-0.7)]
    library = MotionLibrary(clips)
    assert (len(library), library.names) == (2, ("a", "b"))
    for index, clip in enumerate(clips):
        ids = torch.full((clip.frames,), index)
        result = library.frames(ids, torch.arange(clip.frames) / clip.fps)
        for field in fields(result):
            expected = getattr(clip, field.name)
            actual = getattr(result, field.name)
            assert actual.dtype == torch.float32
            np.testing.assert_allclose(actual, expected, atol=2e-6)


def test_between_frames_vectors_are_linear_and_orientation_is_slerp(make_clip):
    clip = make_clip(speed=3.0)
    library = MotionLibrary([clip])
    for share in (0.25, 0.5, 0.9):
        result = at(library, 0, (10 + share) / clip.fps)
        blend = (1 - share) * clip.joint_pos[10] + share * clip.joint_pos[11]
        np.testing.assert_allclose(result.joint_pos[0], blend, atol=1e-5)
        expected = rotations.slerp(clip.root_quat[10], clip.root_quat[11], np.float64(share))
        np.testing.assert_allclose(result.root_quat[0], expected, atol=1e-6)


def test_orientation_is_blended_right_for_fast_turns_and_flipped_signs(make_clip):
    """Bug B12. Neighbours 150 degrees apart and of opposite sign: a linear blend would be far
    off.
    """
    clip = make_clip(frames=3)
    turns = np.array([0.0, 150.0, 300.0])
    quat = rotations.from_yaw(np.radians(turns)) * np.array([[1.0], [-1.0], [1.0]])
    library = MotionLibrary([replace(clip, root_quat=quat)])
    result = at(library, 0, 0.25 / clip.fps).root_quat
    assert result.norm().item() == pytest.approx(1, abs=1e-6)
    assert np.degrees(rotations.yaw(result).item()) == pytest.approx(37.5, abs=1e-3)


def test_times_are_clamped_to_the_clip(make_clip):
    library = MotionLibrary([make_clip("a"), make_clip("b", speed=-2.0)])
    clip = make_clip("a")
    for time, frame in ((-1.0, 0), (-1e-6, 0), (clip.duration, -1), (clip.duration + 5, -1)):
        result = at(library, 0, time)
        np.testing.assert_allclose(result.root_pos[0], clip.root_pos[frame], atol=1e-6)
        np.testing.assert_allclose(result.joint_vel[0], clip.joint_vel[frame], atol=1e-6)
        np.testing.assert_allclose(result.root_quat[0], clip.root_quat[frame], atol=1e-6)


def test_quaternions_are_of_unit_length_at_all_times(make_clip, generator):
    library = MotionLibrary([make_clip(speed=20.0)])
    ids, times = library.sample(1000, generator)
    norms = library.frames(ids, times).root_quat.norm(dim=1)
    torch.testing.assert_close(norms, torch.ones(1000), atol=1e-6, rtol=0)


def test_transitions_come_oldest_first_and_stay_within_their_clip(make_clip, generator):
    """The sign test: joints move from the first state to the second along their velocity."""
    clips = [make_clip("a"), make_clip("b", frames=2), make_clip("c", frames=30, speed=-1.0)]
    library = MotionLibrary(clips)
    first, second = library.sample_transitions(4000, DT, generator)
    moved = (second.joint_pos - first.joint_pos) / DT
    mean = 0.5 * (first.joint_vel + second.joint_vel)
    torch.testing.assert_close(moved, mean, atol=0.03, rtol=0)
    assert torch.corrcoef(torch.stack([moved.flatten(), mean.flatten()]))[0, 1] > 0.99
    turned = rotations.angular_velocity_b(first.root_quat, second.root_quat, DT)
    torch.testing.assert_close(turned, first.root_ang_vel_b, atol=2e-3, rtol=0)


def test_sampling_is_reproducible_and_uniform_over_time(make_clip, generator):
    library = MotionLibrary([make_clip(frames=101, fps=50)])
    ids, times = library.sample(20_000, generator)
    again = library.sample(20_000, torch.Generator().manual_seed(0))
    assert ids.equal(again[0])
    assert times.equal(again[1])
    assert 0 <= times.min() < 0.01
    assert 1.99 < times.max() <= 2.0
    counts = torch.histc(times, 10, 0, 2.0)
    assert (counts - 2000).abs().max() < 5 * 2000**0.5


def share(library, n=40_000, **options):
    ids, _ = library.sample(n, torch.Generator().manual_seed(1), **options)
    return torch.bincount(ids, minlength=len(library)) / n


def test_shares_by_duration_clip_and_skill(make_clip):
    clips = [
        make_clip("a", frames=101, skill="walk", weight=1.0),
        make_clip("b", frames=301, skill="walk", weight=1.0),
        make_clip("c", frames=101, skill="reach", weight=2.0),
        make_clip("unused", frames=101, skill="reach", weight=0.0),
    ]
    expected = {
        "duration": [2 / 12, 6 / 12, 4 / 12, 0],
        "clip": [0.25, 0.25, 0.5, 0],
        "skill": [0.125, 0.375, 0.5, 0],
    }
    for weighting, shares in expected.items():
        actual = share(MotionLibrary(clips, weighting=weighting))
        torch.testing.assert_close(actual, torch.tensor(shares), atol=0.012, rtol=0)
    library = MotionLibrary(clips, weighting="skill", skill_shares={"walk": 3, "reach": 1})
    actual = share(library)
    torch.testing.assert_close(actual, torch.tensor([0.1875, 0.5625, 0.25, 0]), atol=0.012, rtol=0)


def test_clips_shorter_than_the_margin_are_left_out(make_clip):
    library = MotionLibrary([make_clip("short", frames=5), make_clip("long", frames=101)])
    assert share(library)[0] > 0
    assert share(library, margin=1.0).tolist() == [0, 1]
    _, times = library.sample(1000, margin=1.5)
    assert times.max() <= 0.5
    with pytest.raises(DatasetError, match="lasts 3 s"):
        library.sample(1, margin=3.0)


def test_a_clip_exactly_one_step_long_gives_its_only_transition(make_clip):
    clip = make_clip(frames=2, fps=50)
    first, second = MotionLibrary([clip]).sample_transitions(3, DT)
    np.testing.assert_allclose(first.joint_pos, np.tile(clip.joint_pos[0], (3, 1)), atol=1e-6)
    np.testing.assert_allclose(second.joint_pos, np.tile(clip.joint_pos[1], (3, 1)), atol=1e-5)


def test_libraries_that_cannot_be_sampled(make_clip):
    with pytest.raises(DatasetError, match="no clips"):
        MotionLibrary([])
    with pytest.raises(DatasetError, match="other joints"):
        MotionLibrary([make_clip("a"), make_clip("b", joints=2)])
    with pytest.raises(DatasetError, match="positive weight"):
        MotionLibrary([make_clip(weight=0.0)])
    with pytest.raises(DatasetError, match="skill_shares: 'fly'.*walk"):
        MotionLibrary([make_clip(skill="walk")], weighting="skill", skill_shares={"fly": 1.0})


def test_transitions_are_recorded_frames_where_the_step_is_a_whole_number_of_frames(make_clip):
    clip = make_clip(frames=40)
    library = MotionLibrary([clip])
    before, after = library.sample_transitions(64, 1 / clip.fps, torch.Generator().manual_seed(0))
    recorded = torch.from_numpy(clip.joint_pos.astype("float32"))
    for frames in (before, after):
        apart = frames.joint_pos[:, None] - recorded
        assert apart.abs().amax(dim=-1).amin(dim=1).max() < 1e-5


def test_joint_targets_are_those_of_the_frame_or_unknown(make_clip):
    known = make_clip()
    asked = np.arange(known.joint_pos.size, dtype=np.float32).reshape(known.joint_pos.shape)
    library = MotionLibrary([known, replace(known, joint_target=asked)])
    ids, times = torch.tensor([0, 1, 1, 1]), torch.tensor([0.0, 2.0, 3.4, 1e6]) / known.fps
    rows = library.joint_targets(ids, times, 1.0 / known.fps)
    assert rows[0].isnan().all()
    expected = torch.from_numpy(asked[[2, 3, -1]])
    assert torch.equal(rows[1:], expected)
    assert library.joint_targets(ids, times, 0.5 / known.fps).isnan().all()


def test_parts_of_clips_are_drawn_as_often_as_asked(make_clip, generator):
    """The second half of clip 0 three times as often as the first, clip 1 not at all."""
    library = MotionLibrary([make_clip(frames=51, fps=50.0), make_clip(frames=101, fps=50.0)])
    parts = Emphasis(
        np.array([0, 0]), np.array([0.0, 0.5]), np.array([0.5, 1.0]), np.array([1.0, 3.0])
    )
    drawn = library.emphasised(parts)
    clips, times = drawn.sample(4000, generator)
    assert not clips.any()
    assert float((times >= 0.5).float().mean()) == pytest.approx(0.75, abs=0.03)
    assert drawn.shares().tolist() == pytest.approx([1.0, 0.0])
    assert library.shares().tolist() == pytest.approx([1.0 / 3.0, 2.0 / 3.0])
    late = drawn.sample(4000, generator, margin=0.75)[1]
    assert float(late.max()) <= 0.25
    assert float(late.mean()) == pytest.approx(0.125, abs=0.01)
    with pytest.raises(DatasetError, match="lasts 2 s"):
        drawn.sample(1, generator, margin=2.0)


def test_every_clip_as_one_part_draws_what_the_library_draws(make_clip):
    library = MotionLibrary([make_clip(frames=31, fps=50.0), make_clip(frames=101, fps=60.0)])
    whole = Emphasis(np.arange(2), np.zeros(2), library.durations.double().numpy(), np.ones(2))
    for margin in (0.0, 0.02):
        first, second = (
            each.sample(50, torch.Generator().manual_seed(0), margin)
            for each in (library, library.emphasised(whole))
        )
        assert torch.equal(first[0], second[0])
        torch.testing.assert_close(first[1], second[1])
