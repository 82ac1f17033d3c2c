import json

import pytest
from typer.testing import CliRunner

from lacoloco.datasets.store import RunStore
from lacoloco_cli.main import app


def invoke(*arguments):
    return CliRunner().invoke(app, ["runs", "plot", *map(str, arguments)])


@pytest.fixture
def run():
    """A run `seen`, the last one used, in which a high level is being trained."""
    store = RunStore()
    partial = store.begin("seen", "train-high")
    row = {"training": "train-high gan seed 3", "samples": 100, "reward": 0.5}
    partial.file("metrics.jsonl").write_text(json.dumps(row) + "\n")
    store.use("seen")
    return store.root / "seen"


def test_the_picture_lies_in_the_run_unless_asked_for_elsewhere(run, tmp_path):
    result = invoke("--json")
    assert result.exit_code == 0, result.stderr
    answer = json.loads(result.stdout)
    assert answer["picture"].endswith("seen/curves.png")
    assert answer["trainings"] == {"train-high": ["0001 (unfinished) gan seed 3"]}
    assert (run / "curves.png").is_file()
    elsewhere = tmp_path / "mine.svg"
    assert invoke("seen", "--out", elsewhere).stdout.strip().endswith("mine.svg")
    assert b"<svg" in elsewhere.read_bytes()


@pytest.mark.parametrize(
    ("arguments", "hint"),
    [
        (["sene"], "runs: seen"),
        (["--out", "/gone/a.png"], "/gone/a.png"),
        (["--out", "a.doc"], "ends in .png or .pdf or .svg"),
    ],
)
def test_mistakes(run, arguments, hint):
    result = invoke(*arguments)
    assert result.exit_code == 2
    assert hint in result.stderr
    assert result.stderr.count("\n") == 1


def test_nothing_is_drawn_into_a_run_that_is_not_there(tmp_path):
    result = invoke("new")
    assert result.exit_code == 2
    assert "no log" in result.stderr
    assert not (RunStore().root / "new").exists()


def test_a_training_that_has_logged_nothing_to_draw_is_no_bug():
    partial = RunStore().begin("young", "train-low")
    partial.file("metrics.jsonl").write_text('{"training": "train-low gan seed 3", "samples": 0}\n')
    result = invoke("young")
    assert (result.exit_code, result.stderr.count("\n")) == (2, 1)
    assert "nothing to draw yet" in result.stderr
