"""`lacoloco run --methods ... --executor local`: the trials, what a failed one leaves, what a
rerun does.
"""

from __future__ import annotations

import fcntl
import json
from pathlib import Path

import pytest
from typer.testing import CliRunner

from lacoloco.datasets.artifact import read_header
from lacoloco.datasets.store import RunStore
from lacoloco.pipelines.chains.experiments import EXPERIMENTS
from lacoloco.pipelines.chains.sweep import Asked, trials
from lacoloco.pipelines.chains.variants import chosen_methods, of_methods
from lacoloco.pipelines.errors import StageError
from lacoloco.pipelines.stage import StageContext
from lacoloco_cli.main import app
from lacoloco_cli.sweep_file import read_sweep

pytest.importorskip("submitit", reason="needs submitit: pip install 'lacoloco[cluster]'")


def invoke(*arguments):
    return CliRunner().invoke(app, ["run", "solo12-synthetic", "--run", "many", *arguments])


@pytest.fixture
def store(tmp_path, monkeypatch):
    monkeypatch.setenv("LACOLOCO_RUNS", str(tmp_path / "runs"))
    return RunStore(tmp_path / "runs")


def shown(store, methods, *, seed=0, seeds=1):
    """The trials of the synthetic experiment as `--status` shows them."""
    variants = of_methods("solo12-synthetic", methods, {})
    return trials(StageContext(store, "many", seed=seed), variants, seeds, Asked("smoke"))


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
    assert all(row["samples"] > 0 for row in answer["trials"]), "of their high levels"
    assert store.all("many", "train-high")[: len(kept)] == kept
    for stage in ("generate", "train-low", "train-high"):
        assert len(store.all("many", stage)) == (1 if stage == "generate" else 2)
    rows = read_header(store.newest("many", "eval")).metadata["rows"]
    assert sorted(row["method"] for row in rows) == ["drail", "gan"]


def test_trials_are_methods_times_seeds(store):
    found = shown(store, chosen_methods("all"), seed=2, seeds=2)
    assert len(found) == 8
    assert {trial.status for trial in found} == {"missing"}
    assert found[0].name == "gan-seed2"


def test_an_unfinished_trial_says_how_far_it_is(store):
    partial = store.begin("many", "train-low", label="drail-seed0")
    partial.file("metrics.jsonl").write_text('{"samples": 10}\n{"samples": 20}\n')
    (trial,) = shown(store, ["drail"])
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


SWEEP = """
[complete]

[gan]
method = "gan-cat"

[short]
set = ["train-high.decisions=2048"]
"""


@pytest.mark.slow
def test_variants_of_a_file_share_motions_and_low_levels_and_have_a_row_each(store, tmp_path):
    """Those that differ only in the high level train one low level."""
    file = tmp_path / "sweep.toml"
    file.write_text(SWEEP)
    typed = ("--preset", "smoke", "--sweep", str(file), "--set", "eval.episodes=8", "--json")
    missing = json.loads(invoke(*typed, "--status").stdout)
    assert missing["counts"]["missing"] == 3
    first = invoke(*typed)
    assert first.exit_code == 0, first.stderr
    answer = json.loads(first.stdout)
    assert [row["variant"] for row in answer["trials"]] == ["complete", "gan", "short"]
    assert [row["method"] for row in answer["trials"]] == ["drail-cat", "gan-cat", "drail-cat"]
    assert len(store.all("many", "generate")) == 1
    assert len(store.all("many", "train-low")) == 2
    assert answer["trials"][0]["low"] == answer["trials"][2]["low"]
    rows = read_header(store.newest("many", "eval")).metadata["rows"]
    assert [row["variant"] for row in rows] == ["complete", "gan", "short"]
    assert json.loads(invoke(*typed, "--status").stdout)["counts"]["done"] == 3
    report = CliRunner().invoke(app, ["runs", "report", "many"]).stdout
    assert "| variant | seed |" in report
    assert "| short | 0 |" in report.replace(", best on other episodes", "")


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "names no variant"),
        ("[a", "is no TOML"),
        ("a = 1", "write a table per variant"),
        ("['a b']", "use letters"),
        ("[a]\nsett = []", "sett: not known"),
        ("[a]\nmethod = ['gan']", "use one of"),
        ("[a]\nset = 'train-low.samples=1'", "a list of"),
        ("[a]\nmethod = 'wgan'", "drail-cat"),
        ("[a]\nset = ['train-low.sample=1']", "did you mean"),
        ("[a]\nset = ['eval.episodes=1']", "evaluated alike"),
        ("[a]\n[b]", "same as [a]"),
    ],
)
def test_a_file_that_says_what_does_not_exist_is_refused(store, tmp_path, text, said):
    file = tmp_path / "sweep.toml"
    file.write_text(text)
    refused(invoke("--sweep", str(file)), said)


@pytest.mark.parametrize(
    ("name", "experiment"),
    [("ablations", "solo12-synthetic"), ("ablations_h1", "h1-synthetic")],
)
def test_the_ablations_of_a_recipe_are_variants_of_it(name, experiment):
    file = Path(__file__).parents[2] / f"pipelines/chains/{name}.toml"
    typed = {"method": "drail-cat", "preset": "laptop", "common": []}
    found = read_sweep(file, experiment, **typed)
    assert found[0].settings == {}
    assert len({str((one.method, one.settings)) for one in found}) == len(found) > 8


def test_a_file_that_is_not_there_is_refused(store, tmp_path):
    refused(invoke("--sweep", str(tmp_path / "none.toml")), "cannot be read")


def test_a_file_of_variants_goes_with_no_methods(store, tmp_path):
    refused(invoke("--sweep", str(tmp_path / "sweep.toml"), "--methods", "all"), "name a method")


def refused(result, said):
    assert result.exit_code == 2
    assert result.stderr.count("\n") == 1
    assert said in result.stderr


def table_1(*arguments):
    return CliRunner().invoke(app, ["run", "table-1", *arguments])


def test_the_papers_table_has_its_experiments_by_all_methods_and_fresh_seeds(store):
    typed = ("--robot", "solo12", "--seeds", "2", "--status", "--json")
    rows = json.loads(table_1(*typed).stdout)["trials"]
    assert len(rows) == 2 * 4 * 2
    assert {row["seed"] for row in rows} == {10, 11}
    assert rows[0]["variant"] == "solo12-synthetic.gan"
    assert {row["variant"].split(".")[0] for row in rows} <= EXPERIMENTS.keys()
    assert {row["seed"] for row in json.loads(table_1(*typed, "--seed", "3").stdout)["trials"]} == {
        3,
        4,
    }


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        ([], "say whose"),
        (["--robot", "go2"], "the paper has solo12 and h1"),
        (["--robot", "h1", "--set", "trak.samples=1"], "no stage 'trak'"),
        (["--robot", "h1", "--sweep", "x.toml"], "not with table-1"),
    ],
)
def test_what_the_papers_table_does_not_have_is_refused(store, arguments, said):
    refused(table_1(*arguments), said)
