"""`lacoloco run --methods ... --executor local`: the trials, what a failed one leaves, what a
rerun does.
"""

from __future__ import annotations

import fcntl
import json

import pytest
from typer.testing import CliRunner

from lacoloco.datasets.artifact import read_header
from lacoloco.datasets.store import RunStore
from lacoloco.pipelines.chains.sweep import chosen_methods, trials
from lacoloco.pipelines.errors import StageError
from lacoloco_cli.main import app

pytest.importorskip("submitit", reason="needs submitit: pip install 'lacoloco[cluster]'")


def invoke(*arguments):
    return CliRunner().invoke(app, ["run", "solo12-synthetic", "--run", "many", *arguments])


@pytest.fixture
def store(tmp_path, monkeypatch):
    monkeypatch.setenv("LACOLOCO_RUNS", str(tmp_path / "runs"))
    return RunStore(tmp_path / "runs")


@pytest.mark.slow
def test_a_failed_trial_does_not_stop_the_rest_and_a_rerun_does_only_what_is_missing(store):
    """One trial fails because its directory is in use, by this process."""
    busy = store.directory("many", "train-low") / ".0001-gan-seed0.partial"
    busy.mkdir(parents=True)
    typed = ("--preset", "smoke", "--methods", "gan,drail", "--seeds", "1", "--jobs", "2", "--json")
    with (busy / ".lock").open("wb") as lock:
        fcntl.lockf(lock, fcntl.LOCK_EX)
        first = invoke(*typed)
        lock_was_needed = first.exit_code
    assert lock_was_needed == 1
    answer = json.loads(first.stdout)
    status = {row["method"]: row["status"] for row in answer["trials"]}
    assert status == {"gan": "failed", "drail": "done"}
    (failed,) = [row for row in answer["trials"] if row["status"] == "failed"]
    assert "another process" in failed["error"]
    assert answer["counts"] == {"done": 1, "failed": 1, "unfinished": 0, "missing": 0}
    assert answer["artifact"] is not None, "those that are done are evaluated all the same"

    shown = json.loads(invoke(*typed, "--status").stdout)
    assert [row["status"] for row in shown["trials"]] == ["unfinished", "done"]
    kept = store.all("many", "train-high")
    second = invoke(*typed)
    assert second.exit_code == 0, second.stderr
    answer = json.loads(second.stdout)
    assert [row["status"] for row in answer["trials"]] == ["done", "done"]
    assert store.all("many", "train-high")[: len(kept)] == kept
    for stage in ("generate", "train-low", "train-high"):
        assert len(store.all("many", stage)) == (1 if stage == "generate" else 2)
    rows = read_header(store.newest("many", "eval")).metadata["rows"]
    assert sorted(row["method"] for row in rows) == ["drail", "gan"]


def test_trials_are_methods_times_seeds(store):
    found = trials(store, "many", chosen_methods("all"), range(2, 4))
    assert len(found) == 8
    assert {trial.status for trial in found} == {"missing"}
    assert found[0].name == "gan-seed2"


def test_an_unfinished_trial_says_how_far_it_is(store):
    partial = store.begin("many", "train-low", label="drail-seed0")
    partial.file("metrics.jsonl").write_text('{"samples": 10}\n{"samples": 20}\n')
    (trial,) = trials(store, "many", ["drail"], [0])
    assert (trial.status, trial.samples) == ("unfinished", 20)
    table = invoke("--methods", "drail", "--status").stdout
    assert "unfinished" in table and "20" in table


@pytest.mark.parametrize("text", ["wgan", "", "gan,drail-kat"])
def test_methods_that_do_not_exist_are_refused(text):
    with pytest.raises(StageError, match="drail-cat"):
        chosen_methods(text)


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["--methods", "wgan"], "drail-cat"),
        (["--executor", "cloud"], "local or slurm"),
        (["--executor", "local", "--slurm", "partition"], "KEY=VALUE"),
    ],
)
def test_what_does_not_exist_is_refused(store, arguments, said):
    result = invoke(*arguments)
    assert result.exit_code == 2
    assert result.stderr.count("\n") == 1
    assert said in result.stderr
