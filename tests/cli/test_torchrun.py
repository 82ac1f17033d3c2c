"""One training over two processes, started the way a person does."""

from __future__ import annotations

import json
import os
import subprocess
import sys

import pytest
from typer.testing import CliRunner

from lacoloco.datasets.artifact import read_artifact
from lacoloco.datasets.clip import save_clips
from lacoloco.datasets.store import RunStore
from lacoloco.pipelines.benchmarks.throughput import made_up_clips
from lacoloco.pipelines.low_level.trainer import LowTrainer
from lacoloco.pipelines.training import loop as training
from lacoloco.robots.registry import load_robot
from lacoloco_cli.main import app


@pytest.fixture
def motions(tmp_path):
    """A motion artifact of two made-up clips."""
    spec = load_robot("solo12")
    return save_clips(
        tmp_path / "motions.h5",
        made_up_clips(spec, 2, seconds=1.0),
        robot=(spec.name, spec.model_hash()),
        config={},
        seed=0,
        parents=[],
        command="",
    )


@pytest.fixture
def torchrun(tmp_path):
    """`torchrun --nproc-per-node 2 -m -- lacoloco_cli ...` in a runs folder."""

    def run(*arguments):
        command = [sys.executable, "-m", "torch.distributed.run", "--standalone"]
        command += ["--nproc-per-node", "2", "-m", "--", "lacoloco_cli", *arguments]
        environment = {**os.environ, "LACOLOCO_RUNS": str(tmp_path / "runs")}
        return subprocess.run(command, env=environment, capture_output=True, text=True, timeout=900)

    return run


@pytest.mark.slow
def test_two_processes_make_one_artifact_and_one_answer(torchrun, motions, tmp_path, monkeypatch):
    """The second half of a training that one process began: more worlds at once, the same
    budget.
    """
    monkeypatch.setenv("LACOLOCO_RUNS", str(tmp_path / "runs"))
    real, calls = LowTrainer.iterate, []

    def interrupt_the_second(trainer, progress):
        calls.append(progress)
        if len(calls) == 2:
            raise KeyboardInterrupt
        return real(trainer, progress)

    monkeypatch.setattr(LowTrainer, "iterate", interrupt_the_second)
    monkeypatch.setattr(training, "CHECKPOINT_SECONDS", -1.0)
    typed = ("train-low", "--preset", "smoke", "--run", "both", "--motions", str(motions))
    assert CliRunner().invoke(app, list(typed)).exit_code == 130

    ran = torchrun("train-low", "--resume", "--run", "both", "--json")
    assert ran.returncode == 0, ran.stderr
    answer = json.loads(ran.stdout)  # exactly one object
    assert answer["samples"] == 16 * 8 * 3
    store = RunStore(tmp_path / "runs")
    (path,) = store.all("both", "train-low")
    assert store.partials("both", "train-low") == []
    assert read_artifact(path, "lacoloco/policy").config["worlds"] == 16
    logged = [json.loads(line) for line in (path.parent / "metrics.jsonl").read_text().splitlines()]
    assert [line["samples"] for line in logged] == [128, 256, 384]

    ran = torchrun("train-high", "--run", "both", "--preset", "smoke", "--json")
    assert ran.returncode == 0, ran.stderr
    answer = json.loads(ran.stdout)
    assert answer["samples"] == 16 * 4 * 2 * 5
    assert [str(path) for path in store.all("both", "train-high")] == [answer["artifact"]]


@pytest.mark.slow
def test_what_cannot_be_shared_is_refused(torchrun, motions):
    ran = torchrun(
        "train-low", "--preset", "smoke", "--set", "worlds=15", "--motions", str(motions)
    )
    assert ran.returncode != 0
    assert "15 cannot be shared equally by 2 processes" in ran.stderr


@pytest.mark.parametrize("verb", [["generate"], ["eval"], ["run", "quickstart"]])
def test_only_trainings_take_several_processes(verb):
    environment = {"WORLD_SIZE": "2", "RANK": "0"}
    result = CliRunner().invoke(app, verb, env=environment)
    assert result.exit_code == 2
    assert "torchrun" in result.stderr


def test_only_the_first_process_gives_the_answer():
    environment = {"WORLD_SIZE": "2", "RANK": "1"}
    result = CliRunner().invoke(app, ["eval", "--json"], env=environment)
    assert result.exit_code == 2
    assert result.stdout == ""
