"""Moments drawn more evenly over what the clips show."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from lacoloco.datasets.clip import Clip
from lacoloco.datasets.motion_library import MotionLibrary
from lacoloco.pipelines.low_level.cell_balance import balanced, window_motion
from lacoloco.pipelines.low_level.trainer import LowTrainer
from lacoloco.pipelines.sim.clip_actions import clip_states
from lacoloco.pipelines.train_low import smoke


@pytest.fixture
def mostly_standing(solo12, make_clips):
    """Half a second of trotting and turning, then four and a half of standing in another clip."""
    frames = 226
    default = np.tile(solo12.default_joint_pos, (frames, 1))
    position = np.tile([0.0, 0.0, solo12.default_height()], (frames, 1))
    turned = np.tile([1.0, 0.0, 0.0, 0.0], (frames, 1))
    trots = make_clips(solo12, frames=26)[0]

    def library(skill=trots.skill):
        stands = Clip.from_poses(
            "stands", 50.0, solo12.joint_names, position, turned, default, skill=skill
        )
        return MotionLibrary([trots, stands])

    return library


@pytest.mark.parametrize(("balance", "share"), [(1.0, 0.5), (0.5, 0.25)])
def test_what_is_seldom_shown_is_drawn_more_often(solo12, mostly_standing, balance, share):
    """A tenth of the moments trot: all cells alike is a half, and sqrt(0.1) to sqrt(0.9) a
    quarter.
    """
    mostly_standing = mostly_standing()
    generator = torch.Generator().manual_seed(0)
    before = mostly_standing.sample(4000, generator)[0]
    assert float((before == 0).float().mean()) == pytest.approx(0.1, abs=0.02)
    library = balanced(solo12, mostly_standing, balance)
    clips, times = library.sample(4000, generator)
    assert float((clips == 0).float().mean()) == pytest.approx(share, abs=0.03)
    assert float(times[clips == 0].max()) > 0.45
    assert bool((times <= library.durations[clips]).all())
    again, _ = balanced(solo12, library, 0.0).sample(4000, generator)
    assert float((again == 0).float().mean()) == pytest.approx(share, abs=0.03)


def test_skills_are_drawn_as_often_as_before(solo12, mostly_standing):
    """What stands is a skill of its own, and has nine tenths of the moments."""
    library = balanced(solo12, mostly_standing("stand"), 1.0)
    assert float(library.shares()[0]) == pytest.approx(0.1, abs=0.02)


def test_without_it_the_library_is_the_one_that_was_given(solo12, motions):
    assert balanced(solo12, motions, 0.0) is motions


def test_the_motion_of_a_window_by_hand(solo12, mostly_standing):
    """0.4 m/s ahead, 0.5 rad/s to the left, and no window looks into the next clip."""
    motion = window_motion(solo12, clip_states(mostly_standing()))
    assert motion.shape == (252, 4)
    torch.testing.assert_close(
        motion[:20, :3], torch.tensor([0.4, 0.0, 0.5]).expand(20, 3), atol=0.01, rtol=0.0
    )
    torch.testing.assert_close(motion[26:], torch.zeros(226, 4), atol=1e-4, rtol=0.0)


def test_demonstrations_and_resets_are_balanced_and_coverage_is_not(solo12, mostly_standing):
    mostly_standing = mostly_standing()
    config = replace(smoke(), worlds=2, cell_balance=1.0)
    trainer = LowTrainer(solo12, mostly_standing, config, seed=0, device="cpu")
    assert trainer.env.motions is trainer.motions
    assert trainer.selection.motions is mostly_standing
    for drawn in (trainer.motions.shares()[0], (trainer.start.starts(2000) < 26).float().mean()):
        assert float(drawn) == pytest.approx(0.5, abs=0.05)
    speed = trainer.demonstrations(2000)[:, 4]
    assert float((speed > 0.2).float().mean()) == pytest.approx(0.5, abs=0.05)
