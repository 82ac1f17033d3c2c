"""Nearest clips: what a motion resembles."""

import numpy as np
import pytest
import torch

from lacoloco.datasets import rotations
from lacoloco.datasets.clip import Clip
from lacoloco.pipelines.evaluation.skill_classifier import NearestClip
from lacoloco.pipelines.sim.state import RobotState, style_frame


@pytest.fixture
def clips():
    """A clip at 0.4 m/s with level joints, and one that stands with one joint turned."""

    def clip(skill, speed, joint):
        time = np.arange(60) / 50.0
        position = np.column_stack([speed * time, 0 * time, 0.25 + 0 * time])
        joints = np.column_stack([joint + 0 * time, 0 * time])
        quat = rotations.from_yaw(0 * time)
        return Clip.from_poses(skill, 50.0, ("a", "b"), position, quat, joints, skill=skill)

    return [clip("walk", 0.4, 0.0), clip("reach", 0.0, 1.0), clip("walk", 0.3, 0.0)]


def frame(speed, joint):
    qpos = torch.tensor([[0.0, 0.0, 0.25, 1.0, 0.0, 0.0, 0.0, joint, 0.0]])
    qvel = torch.tensor([[speed, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]])
    return style_frame(RobotState.from_generalized(qpos, qvel))


def test_motion_is_nearest_to_the_skill_that_moves_like_it(clips):
    nearest = NearestClip(clips)
    assert nearest.skills == ("walk", "reach")
    found = nearest.distances(torch.cat([frame(0.35, 0.1), frame(0.05, 0.9), frame(0.3, 0.0)]))
    assert found.argmin(dim=1).tolist() == [0, 1, 0]
    assert float(found[2, 0]) < 0.1 < float(found[2, 1])


def test_distances_are_in_standard_deviations_of_the_clips(clips):
    """Joint a is 0 in one half of the moments and 1 in the other: its deviation is 0.5."""
    nearest = NearestClip(clips)
    near, far = nearest.distances(torch.cat([frame(0.0, 1.0), frame(0.0, 2.0)]))[:, 1]
    numbers = frame(0.0, 1.0).shape[1]
    assert float((far**2 - near**2) ** 0.5) == pytest.approx(2.0 / numbers**0.5, rel=0.05)


def test_long_motions_are_compared_part_by_part(clips, monkeypatch):
    from lacoloco.pipelines.evaluation import skill_classifier as nearest_clip

    nearest = NearestClip(clips)
    frames = torch.cat([frame(0.01 * step, 0.0) for step in range(10)])
    whole = nearest.distances(frames)
    monkeypatch.setattr(nearest_clip, "CHUNK", 3)
    assert torch.allclose(nearest.distances(frames), whole, atol=1e-4)
