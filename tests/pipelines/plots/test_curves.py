"""Curves: what is read from the logs, and that it reaches the picture."""

import json

import numpy as np
import pytest

from lacoloco.datasets.store import RunStore
from lacoloco.pipelines.errors import StageError
from lacoloco.pipelines.plots.curves import draw, plot_run, smooth
from lacoloco.pipelines.plots.logs import trainings
from lacoloco.pipelines.plots.panels import PANELS

ITERATIONS = 60


def row(name, index, **metrics):
    return {"training": name, "samples": 1000 * (index + 1), **metrics}


def low(name):
    rows = [
        row(name, index, imitation_reward=0.7, speed=0.3, std=0.1, violation_foot_force=0.02)
        for index in range(ITERATIONS)
    ]
    quantiles = {f"coverage_speed_{p}": v for p, v in (("p10", 0.1), ("p50", 0.2), ("p90", 0.4))}
    shares = {"coverage_walk": 0.25, "coverage_clips": 0.1, "clips_walk": 0.77}
    for index in (19, 59):
        rows[index] |= shares | quantiles
    return rows


def write(folder, rows, end=""):
    (folder / "metrics.jsonl").write_text("".join(json.dumps(r) + "\n" for r in rows) + end)


@pytest.fixture
def store(tmp_path):
    """A run with a low level, complete, and a high level that is being trained."""
    store = RunStore(tmp_path / "runs")
    directory = store.begin("run", "train-low")
    directory.file("artifact.h5").touch()
    write(directory.path, low("train-low drail-cat seed 0"))
    directory.complete()
    partial = store.begin("run", "train-high", label="drail-cat-seed1")
    rows = [row("train-high drail-cat seed 1", i, final_error=1.0 / (i + 1)) for i in range(5)]
    write(partial.path, rows, end='{"training": "train-hi')
    return store


def panels(figure):
    axes = [one for part in figure.subfigs for one in part.axes]
    return {one.get_title(loc="left"): one for one in axes if one.get_title(loc="left")}


def drawn(store, stage):
    return panels(draw({stage: [t for t in trainings(store, "run") if t.stage == stage]}, "run"))


def test_complete_and_unfinished_trainings_are_read_up_to_a_line_cut_short(store):
    found = trainings(store, "run")
    assert [(one.stage, one.label, len(one.samples)) for one in found] == [
        ("train-high", "0001 (unfinished) drail-cat seed 1", 5),
        ("train-low", "0001 drail-cat seed 0", ITERATIONS),
    ]
    walk = found[1].metrics["coverage_walk"]
    assert np.flatnonzero(np.isfinite(walk)).tolist() == [19, 59]


def test_figures_are_drawn_in_the_unit_of_their_panel(store):
    shown = drawn(store, "train-high")
    assert list(shown) == ["Distance at the end of an episode"], "nothing that was not logged"
    axes = shown["Distance at the end of an episode"]
    (line,) = axes.lines
    assert line.get_xdata().tolist() == pytest.approx([0.001, 0.002, 0.003, 0.004, 0.005])
    assert line.get_ydata().tolist() == pytest.approx([100.0, 50.0, 100 / 3, 25.0, 20.0])
    assert axes.get_ylabel() == "cm"


def test_coverage_is_drawn_where_it_was_measured_beside_the_clips(store):
    shown = drawn(store, "train-low")
    skills = shown["Skills from a standing start, no noise"]
    walk, clips = skills.lines[0], skills.lines[-1]
    assert walk.get_xdata().tolist() == pytest.approx([0.02, 0.06])
    assert walk.get_ydata().tolist() == [25.0, 25.0]
    assert set(clips.get_ydata()) == {77.0}
    (band,) = shown["Speed of the base"].collections
    assert band.get_paths()[0].get_extents().intervaly.tolist() == pytest.approx([0.1, 0.4])
    labels = [text.get_text() for text in shown["Constraints"].get_legend().get_texts()]
    assert labels == ["above limit: foot force"]


def test_trainings_of_one_stage_share_panels_and_differ_in_colour(store):
    directory = store.begin("run", "train-low")
    directory.file("artifact.h5").touch()
    write(directory.path, low("train-low gan seed 1"))
    directory.complete()
    figure = draw({"train-low": [t for t in trainings(store, "run") if t.stage == "train-low"]}, "")
    (legend,) = figure.subfigs[0].legends
    assert [text.get_text() for text in legend.get_texts()] == [
        "0001 drail-cat seed 0",
        "0002 gan seed 1",
    ]
    exploration = panels(figure)["Exploration"]
    assert len({line.get_color() for line in exploration.lines}) == 2


def test_smoothing_keeps_levels_also_at_the_ends():
    assert smooth(np.full(10, 3.0), 4) == pytest.approx(np.full(10, 3.0))
    assert smooth(np.array([0.0, 0.0, 3.0, 0.0, 0.0]), 3) == pytest.approx([0, 1, 1, 1, 0])


@pytest.mark.parametrize("name", ["curves.png", "curves.pdf"])
def test_the_picture_is_written_and_may_be_written_again(store, tmp_path, name):
    file = tmp_path / name
    for _ in range(2):
        answer = plot_run(store, "run", file)
    assert answer == {
        "train-low": ["0001 drail-cat seed 0"],
        "train-high": ["0001 (unfinished) drail-cat seed 1"],
    }
    assert file.read_bytes()[:4] in (b"\x89PNG", b"%PDF")
    assert [path.name for path in tmp_path.iterdir() if path.name.startswith(".")] == []


def test_what_cannot_be_drawn_is_said_in_one_line(store, tmp_path):
    with pytest.raises(StageError, match=r"run 'new'.*runs: run"):
        plot_run(store, "new", tmp_path / "a.png")
    with pytest.raises(StageError, match=r"a.doc: not a kind of picture"):
        plot_run(store, "run", tmp_path / "a.doc")
    log = store.all("run", "train-low")[0].with_name("metrics.jsonl")
    log.write_text("nonsense\n" + log.read_text())
    with pytest.raises(StageError, match=r"line 1 is damaged"):
        plot_run(store, "run", tmp_path / "a.png")


def test_no_panel_is_listed_twice():
    for listed in PANELS.values():
        titles = [panel.title for panel in listed]
        assert len(set(titles)) == len(titles)
        assert all(panel.unit for panel in listed)
