import json

import numpy as np
import pytest
from typer.testing import CliRunner

from lacoloco.datasets import provenance, published
from lacoloco.datasets.artifact import write_artifact
from lacoloco.datasets.store import RunStore
from lacoloco_cli.main import app


def invoke(*arguments):
    return CliRunner().invoke(app, ["runs", *map(str, arguments)])


@pytest.fixture
def policy(tmp_path, monkeypatch):
    """A run `good` with a high level, and an empty folder of published artifacts."""
    folder = tmp_path / "published"
    folder.mkdir()
    monkeypatch.setattr(published, "FOLDER", folder)
    monkeypatch.setattr(provenance, "git_commit", lambda: "a" * 40)
    directory = RunStore().begin("good", "train-high")
    write_artifact(
        directory.file("artifact.h5"),
        "lacoloco/policy",
        {"a": np.arange(4.0)},
        metadata={"method": "drail-cat"},
        config={},
        seed=0,
        robot=("solo12", "abc"),
    )
    return directory.complete()


@pytest.mark.parametrize("by", ["run", "path"])
def test_a_run_or_a_path_is_published_and_found_by_its_name(policy, by):
    source = "good" if by == "run" else policy
    result = invoke("publish", source, "solo12-synthetic", "--json")
    assert result.exit_code == 0, result.stderr
    answer = json.loads(result.stdout)
    copy = published.FOLDER / "solo12-synthetic.h5"
    assert answer["published"] == str(copy)
    assert answer["bytes"] == copy.stat().st_size < answer["total_bytes"]
    assert "README" in result.stderr
    shown = json.loads(invoke("show", "solo12-synthetic", "--json").stdout)
    assert shown["artifacts"][0]["path"] == str(copy)
    assert json.loads(invoke("verify", "solo12-synthetic", "--json", "--quiet").stdout)["intact"]


def test_what_is_refused_is_said_in_one_line(policy):
    assert invoke("publish", "good", "low").exit_code == 0
    for arguments, hint in (
        (("good", "low"), "published already"),
        (("good", "Low"), "lower-case"),
        (("gone", "other"), "run 'gone'"),
    ):
        result = invoke("publish", *arguments)
        assert result.exit_code == 2
        assert hint in result.stderr
        assert result.stderr.count("\n") == 1


@pytest.mark.parametrize(
    "arguments",
    [
        ["train-high", "--low", "solo12-nothing"],
        ["eval", "--policy", "solo12-nothing"],
        ["export", "--policy", "solo12-nothing"],
        ["play", "solo12-nothing"],
        ["train-low", "--motions", "solo12-nothing"],
    ],
)
def test_names_that_are_not_published_are_refused_with_those_that_are(policy, arguments):
    invoke("publish", "good", "solo12-synthetic")
    result = CliRunner().invoke(app, [*arguments, "--preset", "smoke"])
    assert result.exit_code == 2
    assert "solo12-nothing" in result.stderr and "solo12-synthetic" in result.stderr
    assert result.stderr.count("\n") == 1
