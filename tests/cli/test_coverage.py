import json
from pathlib import Path

import pytest
import torch
from typer.testing import CliRunner

from lacoloco.datasets.store import RunStore
from lacoloco.pipelines.evaluation import policy_coverage as measuring
from lacoloco.pipelines.evaluation.skill_cells import CellCoverage, SkillCells
from lacoloco_cli.main import app


def invoke(*arguments):
    return CliRunner().invoke(app, ["runs", "coverage", *map(str, arguments)])


@pytest.fixture
def asked(monkeypatch):
    """What is asked of the measurement, whose answer is made up: a latent walks, none turns."""
    calls = []

    def measured(policy, motions, *, latents, seed, progress):
        calls.append((policy, motions, latents, seed))
        on, left = [0.3, 0.0, 0.0, 0.0], [0.3, 0.0, 0.8, 0.0]
        cells = SkillCells(0.15, 0.4, 0.1)
        return CellCoverage(cells, torch.tensor([on] * 3 + [left]), torch.tensor([on]), latents)

    monkeypatch.setattr(measuring, "policy_coverage", measured)
    return calls


@pytest.fixture
def run():
    """A run `seen`, the last one used, with a low level."""
    store = RunStore()
    folder = store.root / "seen" / "train-low" / "0001"
    folder.mkdir(parents=True)
    (folder / "artifact.h5").write_bytes(b"")
    store.use("seen")
    return store.root / "seen"


def test_the_newest_low_level_of_the_run_is_drawn_there(run, asked):
    result = invoke("--json")
    assert result.exit_code == 0, result.stderr
    answer = json.loads(result.stdout)
    assert (run / "coverage.png").is_file()
    assert answer["picture"].endswith("seen/coverage.png")
    assert answer["coverage_cells"] == 0.75
    assert answer["lost"] == [{"cell": "forward 0.3 m/s, turning left 0.8 rad/s", "share": 0.25}]
    assert asked == [(run / "train-low" / "0001" / "artifact.h5", [], 256, 0)]


def test_a_named_policy_is_drawn_where_one_is(asked, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("low.h5").write_bytes(b"")
    Path("clips.h5").write_bytes(b"")
    result = invoke("low.h5", "--motions", "clips.h5", "--latents", 8, "--seed", 3)
    assert result.exit_code == 0, result.stderr
    assert Path("coverage.png").read_bytes().startswith(b"\x89PNG")
    assert "8 latents: reach 75.0% of what the clips show; 0.0% turn left" in result.stdout
    assert "turning left 0.8 rad/s" in result.stdout
    assert asked == [(Path("low.h5"), [Path("clips.h5")], 8, 3)]


@pytest.mark.parametrize(
    ("arguments", "hint"),
    [
        ([], "train-low"),
        (["--out", "a.doc"], ".png"),
        (["--out", "/gone/a.png"], "/gone/a.png"),
        (["gone.h5"], "gone.h5"),
        (["--latents", "0"], "--latents"),
    ],
)
def test_mistakes(arguments, hint):
    result = invoke(*arguments)
    assert result.exit_code == 2
    assert hint in result.stderr
    assert result.stderr.count("\n") == 1
