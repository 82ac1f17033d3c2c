"""The picture of the hardware shift, and its option."""

import pytest
from typer.testing import CliRunner

from lacoloco.pipelines.errors import StageError
from lacoloco.pipelines.plots.shift import draw_shift
from lacoloco_cli.main import app

ROWS = [
    {
        "name": name,
        "episodes": 4,
        "success_5cm_pct": near,
        "success_30cm_pct": 100.0,
        "intervals": {"success_5cm_pct": [near - 20.0, near], "success_30cm_pct": [60.0, 100.0]},
    }
    for name, near in (("undisturbed", 100.0), ("everything", 50.0))
]


def test_a_bar_per_row(tmp_path):
    draw_shift(tmp_path / "shift.svg", ROWS)
    text = (tmp_path / "shift.svg").read_text()
    assert "undisturbed" in text and "everything" in text
    with pytest.raises(StageError, match="not a kind of picture"):
        draw_shift(tmp_path / "shift.txt", ROWS)


def test_without_a_shift_there_is_nothing_to_draw(tmp_path, monkeypatch):
    monkeypatch.setenv("LACOLOCO_RUNS", str(tmp_path / "runs"))
    arguments = ["eval", "--policy", "solo12-synthetic", "--figure", str(tmp_path / "a.png")]
    result = CliRunner().invoke(app, arguments)
    assert result.exit_code == 2
    assert "--figure draws the table of --shift; give both" in result.stderr
