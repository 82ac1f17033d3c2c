"""`lacoloco bench gpu`, from end to end on the CPU in a tiny size."""

from __future__ import annotations

import json
import signal
import time

import pytest
from typer.testing import CliRunner

from lacoloco.datasets.store import RunStore
from lacoloco.pipelines.benchmarks import gpu as gpu_bench
from lacoloco.pipelines.benchmarks.gpu import TRAININGS, interrupted_after
from lacoloco.pipelines.errors import StageError
from lacoloco_cli.main import app

TINY = ("gpu", "--worlds", "8", "--seconds", "0", "--device", "cpu")


def invoke(*arguments):
    return CliRunner().invoke(app, ["bench", *arguments])


@pytest.fixture
def store(tmp_path, monkeypatch):
    monkeypatch.setenv("LACOLOCO_RUNS", str(tmp_path / "runs"))
    return RunStore(tmp_path / "runs")


@pytest.fixture
def measured(monkeypatch):
    """Instead of measuring: parity and rates that were agreed upon."""
    rate = {"steps_per_second": 250_000.0, "ratio_to_engine": 0.5, "engine": "x", "worlds": 8}
    monkeypatch.setattr(gpu_bench, "check_parity", lambda spec, device, worlds: {"qpos": 1e-7})
    for name in ("bench_sim", "bench_train"):
        monkeypatch.setattr(gpu_bench, name, lambda config, **options: dict(rate))


@pytest.mark.slow
def test_it_measures_the_whole_table_with_warp(store, monkeypatch, tmp_path):
    pytest.importorskip("mujoco_warp", reason="needs MuJoCo Warp: pip install 'lacoloco[gpu]'")
    monkeypatch.setenv("LACOLOCO_PHYSICS", "warp")
    result = invoke(*TINY, "--out", str(tmp_path / "out"), "--json")
    assert result.exit_code == 0, result.stderr
    answer = json.loads(result.stdout)
    assert [row["robot"] for row in answer["parity"]] == ["solo12", "h1"]
    assert all(row["touching"] > 0.1 for row in answer["parity"]), "forces were compared, too"
    assert [row["engine"] for row in answer["rows"]] == ["WarpPhysics"] * 3
    assert [row["robot"] for row in answer["rows"]] == ["solo12", "solo12", "h1"]
    assert all(row["steps_per_second"] > 0 for row in answer["rows"])
    assert answer["trainings"] == []
    for folder in (tmp_path / "out", store.directory("bench-gpu")):
        written = json.loads((folder / "metrics.json").read_text())
        assert written["rows"] == answer["rows"]
        assert written["machine"]["torch"]


@pytest.mark.slow
def test_the_remaining_minutes_are_spent_on_trainings(store, measured, monkeypatch, tmp_path):
    monkeypatch.setattr(gpu_bench, "TRAININGS", TRAININGS[:1])
    out = tmp_path / "out"
    typed = (*TINY, "--minutes", "30", "--preset", "smoke", "--out", str(out), "--json")
    answer = json.loads(invoke(*typed).stdout)
    (row,) = answer["trainings"]
    assert (row["experiment"], row["method"], row["status"]) == (
        "solo12-synthetic",
        "drail-cat",
        "done",
    )
    assert row["evaluation"]["ee_error_mean_m"] > 0
    policy = out / "solo12-synthetic-drail-cat-seed0.h5"
    assert policy.stat().st_size < 16e6
    kept = store.all("bench-gpu-solo12-synthetic", "train-high")
    assert len(kept) == 1
    invoke(*typed)
    assert store.all("bench-gpu-solo12-synthetic", "train-high") == kept, "nothing is trained twice"


def test_what_is_known_is_on_disk_when_it_is_cut_short(store, measured, monkeypatch):
    def broken(config, **options):
        raise StageError("the card is gone")

    monkeypatch.setattr(gpu_bench, "bench_train", broken)
    result = invoke(*TINY)
    assert result.exit_code == 2
    written = json.loads((store.directory("bench-gpu") / "metrics.json").read_text())
    assert [row["name"] for row in written["rows"]] == ["Solo12 env loop"]


def test_engines_that_disagree_end_it_before_anything_is_measured(store, measured, monkeypatch):
    def differ(spec, device, worlds):
        raise StageError("MuJoCo Warp and the C engine differ in qpos")

    monkeypatch.setattr(gpu_bench, "check_parity", differ)
    result = invoke(*TINY)
    assert result.exit_code == 2 and "differ in qpos" in result.stderr
    assert json.loads((store.directory("bench-gpu") / "metrics.json").read_text())["rows"] == []


def test_a_training_without_time_left_is_cut_short_and_said_so(store, measured, monkeypatch):
    def endless(*arguments, **options):
        time.sleep(60.0)

    monkeypatch.setattr(gpu_bench, "_train", endless)
    answer = json.loads(invoke(*TINY, "--minutes", "0.005", "--json").stdout)
    assert [row["status"] for row in answer["trainings"]] == ["cut short"]


def test_the_table_says_what_the_rate_amounts_to(store, measured):
    answer = json.loads(invoke(*TINY, "--json").stdout)
    training = answer["rows"][1]
    assert training["paper_budget_minutes_at_this_rate"] == pytest.approx(61.17, abs=0.01)
    assert "Solo12 env loop" in invoke(*TINY).stdout


def test_the_alarm_is_off_afterwards():
    before = signal.getsignal(signal.SIGALRM)
    with pytest.raises(KeyboardInterrupt), interrupted_after(0.01):
        time.sleep(10.0)
    with interrupted_after(30.0):
        pass
    assert signal.getitimer(signal.ITIMER_REAL)[0] == 0.0
    assert signal.getsignal(signal.SIGALRM) is before


def test_the_alarm_rings_where_ctrl_c_is_ignored():
    """As it is in a job that a shell has put into the background."""
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        with pytest.raises(KeyboardInterrupt), interrupted_after(0.01):
            time.sleep(10.0)
    finally:
        signal.signal(signal.SIGINT, before)


def test_a_preset_that_does_not_exist_is_refused(store):
    result = invoke(*TINY, "--preset", "huge")
    assert result.exit_code == 2 and "paper" in result.stderr
