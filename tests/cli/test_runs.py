import json

import h5py
import numpy as np
import pytest
from typer.testing import CliRunner

from lacoloco.datasets.artifact import write_artifact
from lacoloco.datasets.store import RunStore
from lacoloco_cli.runs import app


@pytest.fixture
def call():
    def run(*arguments):
        return CliRunner().invoke(app, list(arguments))

    return run


@pytest.fixture
def add():
    """Complete one version of a stage in the store that the command reads."""

    def factory(run, stage, parents=(), **options):
        stage_dir = RunStore().begin(run, stage)
        values = {"metadata": {}, "config": {"rate": 0.5}, "seed": 3, "robot": ("solo12", "abc")}
        write_artifact(
            stage_dir.file("artifact.h5"),
            "lacoloco/motions",
            {"a": np.arange(4.0)},
            parents=parents,
            command=f"lacoloco {stage}",
            **{**values, **options},
        )
        return stage_dir.complete()

    return factory


@pytest.fixture
def chain(add, tmp_path):
    mocap = tmp_path / "dog.bvh"
    mocap.write_text("HIERARCHY")
    clips = add("dog", "retarget", [mocap])
    low = add("dog", "train-low", [clips])
    RunStore().use("dog")
    return mocap, clips, low


def test_list_of_nothing(call):
    result = call("list")
    assert (result.exit_code, json.loads(call("list", "--json").stdout)["artifacts"]) == (0, [])
    assert "quickstart" in result.stdout


def test_list_shows_complete_unfinished_and_damaged(call, chain, add):
    RunStore().begin("dog", "train-low", label="gan-seed1")
    broken = add("cat", "generate")
    broken.write_bytes(broken.read_bytes()[:500])
    listed = json.loads(call("list", "--json").stdout)
    rows = [(r["run"], r["stage"], r["version"], r["state"]) for r in listed["artifacts"]]
    assert rows == [
        ("cat", "generate", "0001", "damaged"),
        ("dog", "retarget", "0001", "complete"),
        ("dog", "train-low", "0001", "complete"),
        ("dog", "train-low", "0002", "unfinished"),
    ]
    assert listed["last_run"] == "dog"
    assert listed["artifacts"][1]["seed"] == 3
    assert listed["artifacts"][3]["label"] == "gan-seed1"
    text = call("list").stdout
    assert "unfinished" in text and "damaged" in text


def test_show_prints_the_lineage_back_to_the_mocap_file(call, chain):
    mocap, clips, low = chain
    (shown,) = json.loads(call("show", "dog", "--json").stdout)["artifacts"]
    assert shown["path"] == str(low)
    assert (shown["config"], shown["seed"], shown["command"]) == (
        {"rate": 0.5},
        3,
        "lacoloco train-low",
    )
    assert [(a["depth"], a["path"]) for a in shown["lineage"]] == [
        (0, str(low)),
        (1, str(clips)),
        (2, str(mocap)),
    ]
    text = call("show").stdout  # the run used last
    assert "dog.bvh" in text and shown["content_hash"] in text
    for target in (str(clips), str(clips.parent)):
        (one,) = json.loads(call("show", target, "--json").stdout)["artifacts"]
        assert one["path"] == str(clips)


def test_show_of_something_unknown(call, chain):
    for target, words in (("mouse", "runs: dog"), ("gone.h5", "no such artifact")):
        result = call("show", target)
        assert result.exit_code == 2
        assert words in result.stderr


def test_verify_passes_and_finds_a_flipped_byte(call, chain):
    _, clips, low = chain
    result = call("verify", "--json", "--quiet")
    assert (result.exit_code, json.loads(result.stdout)["intact"]) == (0, True)
    assert len(json.loads(result.stdout)["artifacts"]) == 2

    content = bytearray(clips.read_bytes())
    content[content.index(np.arange(4.0).tobytes()) + 9] ^= 1
    clips.write_bytes(content)
    result = call("verify", "--json", "--quiet")
    report = {r["path"]: r for r in json.loads(result.stdout)["artifacts"]}
    assert result.exit_code == 2
    assert "does not match its hash" in report[str(clips)]["problems"][0]
    assert "is changed" in report[str(low)]["problems"][0]
    assert call("verify", str(clips)).exit_code == 2
    assert "BAD" in call("verify", "dog").stdout


def test_verify_notes_a_source_that_is_gone_but_not_one_that_was_replaced(call, chain):
    mocap, clips, _ = chain
    mocap.unlink()
    result = call("verify", str(clips), "--json")
    (report,) = json.loads(result.stdout)["artifacts"]
    assert (result.exit_code, report["intact"]) == (0, True)
    assert "is missing" in report["problems"][0]
    mocap.write_text("something else")
    assert call("verify", str(clips)).exit_code == 2


def test_one_bad_file_does_not_hide_the_others(call, chain, add):
    import os

    _, clips, low = chain
    deep, pipe = add("dog", "track"), add("dog", "generate")
    with h5py.File(deep, "r+") as file:
        file.attrs["metadata"] = np.bytes_(b"[" * 100_000)
    pipe.unlink()
    os.mkfifo(pipe)
    listed = call("list", "--json")
    assert listed.exit_code == 0
    states = {row["path"]: row["state"] for row in json.loads(listed.stdout)["artifacts"]}
    assert (states[str(clips)], states[str(low)]) == ("complete", "complete")
    assert states[str(deep)] == "damaged"
    verified = call("verify", "--json")
    assert verified.exit_code == 2
    intact = {row["path"]: row["intact"] for row in json.loads(verified.stdout)["artifacts"]}
    assert (intact[str(clips)], intact[str(low)], intact[str(deep)]) == (True, True, False)
    shown = call("show", "dog", "--json")
    assert shown.exit_code == 2
    answer = json.loads(shown.stdout)
    assert [one["path"] for one in answer["artifacts"]] == [str(low)]
    assert any(str(deep) in problem for problem in answer["problems"])
