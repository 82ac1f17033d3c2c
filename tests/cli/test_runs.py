import json
import subprocess
import sys
from pathlib import Path

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


@pytest.fixture
def with_page():
    stage_dir = RunStore().begin("dog", "play")
    stage_dir.file("page.html").write_text("page")
    values = {"metadata": {}, "config": {}, "seed": 0, "robot": None}
    write_artifact(stage_dir.file("artifact.h5"), "lacoloco/motions", {}, **values)
    return stage_dir.complete()


def flip(page):
    page.write_text("pagf")


def link(page):
    page.rename(page.parent.parent / "elsewhere")
    page.symlink_to(page.parent.parent / "elsewhere")


@pytest.mark.parametrize(
    ("harm", "said"),
    [
        (flip, "page.html beside it does not match its hash"),
        (link, "page.html beside it does not match its hash"),
        (
            lambda page: page.unlink(),
            "not there beside it: page.html; a version is copied as a whole folder (0001/), never"
            " artifact.h5 alone",
        ),
    ],
)
def test_verify_compares_the_files_beside_an_artifact(call, with_page, harm, said):
    assert call("verify").exit_code == 0
    harm(with_page.with_name("page.html"))
    result = call("verify", "--json", "--quiet")
    assert result.exit_code == 2
    assert json.loads(result.stdout)["artifacts"][0]["problems"] == [said]


def test_verify_names_the_files_without_a_hash(call, with_page, monkeypatch):
    """One that was added, and all beside an artifact of before, which are intact all the same."""
    with_page.with_name("note.txt").write_text("mine")
    result = call("verify", "--json", "--quiet")
    assert result.exit_code == 0
    assert json.loads(result.stdout)["artifacts"][0]["without_hash"] == ["note.txt"]
    assert "no hash of note.txt" in call("verify").stdout

    old = RunStore().root / "old/play/0001/artifact.h5"
    values = {"metadata": {}, "config": {}, "seed": 0, "robot": None}
    write_artifact(old, "lacoloco/motions", {}, **values)
    old.with_name("page.html").write_text("page")
    answer = json.loads(call("verify", "old", "--json", "--quiet").stdout)
    assert (answer["intact"], answer["artifacts"][0]["without_hash"]) == (True, ["page.html"])


def test_clean_shows_and_then_removes_what_killed_stages_left(call, chain):
    _, clips, low = chain
    killed = RunStore().begin("dog", "train-low", label="gan-seed1")
    killed.file("x.checkpoint.h5").write_text("x" * 10)
    killed._release()
    (low.parent / ".lock").touch()
    half = low.parent.parent / ".0007.removed"
    half.mkdir()
    expected = {str(killed.path), str(low.parent / ".lock"), str(half)}
    for word, there in (((), True), (("--yes",), False)):
        answer = json.loads(call("clean", "--json", *word).stdout)
        assert {row["path"] for row in answer["left"]} == expected
        assert killed.path.exists() == (low.parent / ".lock").exists() == half.exists() == there
    assert "nothing to remove" in call("clean", "dog").stdout
    assert clips.is_file() and low.is_file()
    assert call("clean", "mouse").exit_code == 2


def test_clean_leaves_what_another_process_works_on(call, chain):
    code = (
        "import sys\nfrom lacoloco.datasets.store import RunStore\n"
        "stage = RunStore().begin('dog', 'train-low')\n"
        "print(stage.path, flush=True)\nsys.stdin.read()\n"
    )
    pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE}
    with subprocess.Popen([sys.executable, "-c", code], **pipes) as other:
        path = Path(other.stdout.readline().decode().strip())
        assert json.loads(call("clean", "--yes", "--json").stdout)["left"] == []
        assert path.is_dir()
        other.kill()
    assert len(json.loads(call("clean", "--yes", "--json").stdout)["left"]) == 1
    assert not path.exists()
