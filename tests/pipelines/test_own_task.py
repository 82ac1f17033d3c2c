"""A high level trained on a task of one's own: it follows a velocity instead of reaching."""

from dataclasses import replace
from pathlib import Path

import pytest
import torch

from lacoloco.datasets.store import RunStore
from lacoloco.pipelines import evaluate, export, train_high
from lacoloco.pipelines.errors import StageError
from lacoloco.pipelines.evaluation.rollout import record_reach
from lacoloco.pipelines.learn.networks import NetworkConfig, make_actor
from lacoloco.pipelines.play import PlaybackConfig, policy_recordings
from lacoloco.pipelines.policies import Head, Policy, load_policies, save_policies, task_of
from lacoloco.pipelines.stage import StageContext

TASK = Path(__file__).parents[2] / "robots/solo12/tasks/follow_velocity.toml"


@pytest.fixture
def context(tmp_path):
    return StageContext(store=RunStore(tmp_path / "runs"), run="own")


@pytest.fixture
def low(solo12, context, tmp_path):
    """The artifact of an untrained low level of Solo12."""
    torch.manual_seed(0)
    sizes, networks = {"policy": 46, "latent": 7}, NetworkConfig(actor=(16,))
    policy = Policy(
        Head("low", sizes, 12, networks, [], "imitate"), make_actor(sizes, 12, networks).eval()
    )
    return save_policies(
        tmp_path / "low.h5",
        [policy],
        spec=solo12,
        context=context,
        config={},
        parents=[],
        metrics={},
        metadata={"method": "drail-cat"},
    )


@pytest.fixture
def trained(low, context):
    return train_high.run(train_high.smoke(), context, low=low, task=TASK)


def test_it_is_trained_and_reports_the_tasks_reward_and_no_error(trained, solo12):
    metrics = trained.metrics
    assert metrics["trained_reward"] > 0 and metrics["untrained_reward"] > 0
    assert not [name for name in metrics if "error" in name]
    artifact, policies = load_policies(trained.artifact, "high")
    names = [row["name"] for row in policies["high"].head.layout]
    assert names[-2:] == ["velocity_command", "last_latent"]
    assert policies["high"].head.task == "follow_velocity"
    assert task_of(artifact, solo12).command.forward == (0.0, 0.5)


def test_its_evaluation_reports_the_tasks_reward(trained, context):
    config = evaluate.PRESETS["smoke"]()
    (row,) = evaluate.run(config, context, policies=[trained.artifact]).metrics["rows"]
    assert row["task_reward"] > 0
    assert 0 <= row["falls_pct"] <= 100
    assert "ee_error_mean_m" not in row


def test_what_cannot_be_evaluated_with_it_leaves_no_evaluation(trained, low, context):
    config = evaluate.PRESETS["smoke"]()
    with pytest.raises(StageError, match="the policy's task has no target"):
        evaluate.run(replace(config, shift="hardware"), context, policies=[trained.artifact])
    reaches = train_high.run(train_high.smoke(), context, low=low)
    with pytest.raises(StageError, match="one kind at a time"):
        evaluate.run(config, context, policies=[trained.artifact, reaches.artifact])
    assert not (context.store.root / context.run / "eval").exists()


def test_it_is_played_and_exported_on_its_own_task(trained, context):
    played = record_reach(trained.artifact, seconds=0.5)
    assert played.target is None
    (recording,) = policy_recordings(trained.artifact, PlaybackConfig(seconds=0.5, episodes=1), 0)
    assert recording.target is None and "target" not in recording.note
    assert export.run(export.PRESETS["smoke"](), context, policy=trained.artifact).metrics["onnx"]


def test_a_mistake_in_the_file_stops_it_before_it_begins(low, context, tmp_path):
    file = tmp_path / "wrong.toml"
    file.write_text(TASK.read_text().replace("variance", "varience", 1))
    with pytest.raises(ValueError, match=r"rewards\[0\]\.varience: unknown key; did you mean"):
        train_high.run(train_high.smoke(), context, low=low, task=file)
