"""What is said of recorded clips."""

from dataclasses import replace
from types import SimpleNamespace

import pytest
import torch

from lacoloco.datasets.store import RunStore
from lacoloco.pipelines.generate import smoke
from lacoloco.pipelines.generation.recorder import _tracking_error, record
from lacoloco.pipelines.stage import StageContext


def walking(velocity, yaw_rate):
    state = SimpleNamespace(
        lin_vel_b=torch.tensor([[*velocity, 0.7]]), ang_vel_b=torch.tensor([[0.3, 0.4, yaw_rate]])
    )
    return SimpleNamespace(task=SimpleNamespace(name="walk"), state=state)


def test_turning_is_counted_beside_walking():
    """0.3 m/s ahead and 0.4 m/s beside the command, and 0.2 rad/s too slow: a 3-4-5 triangle."""
    error = _tracking_error(walking((0.5, 0.1), 0.1), torch.tensor([[0.2, 0.5, 0.3]]))
    assert error.tolist() == [pytest.approx([0.5, 0.2])]


def test_a_robot_that_stands_misses_its_commands_by_the_commands(solo12, tmp_path):
    """Uniform in +-0.5 m/s and +-0.78 rad/s: means of 0.38 and 0.39. None ends in a second."""
    config = replace(smoke(), seconds=1.0, transient_s=0.5)
    context = StageContext(RunStore(tmp_path), "recorded")

    def still(observation):
        return torch.zeros(len(observation), 12)

    clips, metrics = record(solo12, "walk", still, 24, config, context)
    assert len(clips) == 24
    assert metrics["walk_error_mean"] == pytest.approx(0.38, abs=0.1)
    assert metrics["walk_yaw_error_mean"] == pytest.approx(0.39, abs=0.1)
    assert metrics["walk_yaw_error_settled"] is None
    assert "reach_yaw_error_mean" not in metrics
