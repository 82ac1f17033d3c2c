"""The curves of all trainings of a run as one picture: a section per stage, a panel per kind of
metric.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure, SubFigure
from matplotlib.lines import Line2D
from matplotlib.ticker import FormatStrFormatter, LogLocator, NullFormatter

from lacoloco.datasets.store import RunStore
from lacoloco.pipelines.errors import StageError
from lacoloco.pipelines.plots.logs import Training, trainings
from lacoloco.pipelines.plots.panels import PANELS, TITLES, Line, Panel
from lacoloco.pipelines.plots.style import COLOURS, DASHES, GREY, label_y, paper_style, save

COLUMNS, LEGEND_COLUMNS = 4, 5
PANEL_SIZE = (3.0, 1.85)
"""Width and height of a panel [inches]."""
SMOOTHED_OVER = 40
"""A curve is averaged over this part of its length; what was logged is drawn faintly behind it."""
SPARSE = 30
"""Curves of fewer points are drawn as they are, with their points."""


def plot_run(store: RunStore, run: str, file: Path) -> dict[str, list[str]]:
    """Draw every training of a run.

    Returns:
        Stage -> labels of its trainings.

    Raises:
        StageError: the run has no trainings, a log is damaged, or the picture cannot be written.
    """
    found = trainings(store, run)
    stages = {stage: [one for one in found if one.stage == stage] for stage in PANELS}
    stages = {stage: members for stage, members in stages.items() if members}
    with paper_style():
        save(draw(stages, f"run {run}"), file)
    return {stage: [one.label for one in members] for stage, members in stages.items()}


def draw(stages: dict[str, list[Training]], title: str) -> Figure:
    """A section per stage, each with the panels that its trainings have metrics for.

    Raises:
        StageError: No training has logged anything that is drawn.
    """
    shown = {stage: _shown(PANELS[stage], members) for stage, members in stages.items()}
    stages = {stage: members for stage, members in stages.items() if shown[stage]}
    if not stages:
        raise StageError(f"{title}: its trainings have logged nothing to draw yet; train on")
    rows = {stage: -(-len(panels) // COLUMNS) for stage, panels in shown.items()}
    heads = {
        stage: 0.5 + 0.17 * (-(-len(members) // LEGEND_COLUMNS))
        for stage, members in stages.items()
    }
    heights = [PANEL_SIZE[1] * rows[stage] + heads[stage] for stage in stages]
    figure = Figure(figsize=(PANEL_SIZE[0] * COLUMNS, sum(heights) + 0.1), layout="constrained")
    parts = figure.subfigures(len(stages), 1, height_ratios=heights, squeeze=False).ravel()
    for part, (stage, members) in zip(parts, stages.items(), strict=True):
        _section(part, f"{TITLES[stage]}, {title}", members, shown[stage], rows[stage])
    return figure


def smooth(values: np.ndarray, width: int) -> np.ndarray:
    """Centred moving average over ``width`` values; towards the ends over those that are there."""
    kernel = np.ones(width)
    return np.convolve(values, kernel, "same") / np.convolve(np.ones(len(values)), kernel, "same")


def _section(
    part: SubFigure, title: str, members: Sequence[Training], panels: list[Panel], rows: int
) -> None:
    grid = np.atleast_1d(part.subplots(rows, COLUMNS)).ravel()
    for axes, panel in zip(grid, panels, strict=False):
        _panel(axes, panel, members)
    for axes in grid[len(panels) :]:
        axes.set_axis_off()
    part.supxlabel("samples [million control steps]", fontsize=8.0)
    alone = f", {members[0].label}" if len(members) == 1 else ""
    part.suptitle(title + alone, x=0.006, ha="left", fontsize=10.5, fontweight="bold")
    if not alone:
        handles = [
            Line2D([], [], color=_colour(index), label=one.label)
            for index, one in enumerate(members)
        ]
        part.legend(handles=handles, loc="outside upper right", ncols=LEGEND_COLUMNS, fontsize=7.5)


def _panel(axes: Axes, panel: Panel, members: Sequence[Training]) -> None:
    label_y(axes, panel.title, panel.unit)
    handles: dict[str, Line2D] = {}
    several = len(members) > 1
    for index, training in enumerate(members):
        for position, line in enumerate(_expand(panel.lines, training)):
            look: dict[str, Any] = {
                "color": _colour(index if several else position),
                "linestyle": DASHES[position % len(DASHES)] if several else "-",
            }
            _curve(axes, training, line, look, panel.log)
            if line.label:
                shown = look if not several else look | {"color": GREY}
                handles.setdefault(line.label, Line2D([], [], label=line.label, **shown))
        for position, line in enumerate(_expand(panel.references, training)):
            value = training.metrics[line.metric]
            level = line.factor * value[np.isfinite(value)][-1]
            # Of one training, the clips' line has the colour of what it is to be compared with.
            colour = GREY if several or len(panel.references) == 1 else _colour(position)
            axes.axhline(level, color=colour, linestyle=":", linewidth=1.0, zorder=1.5)
            if line.label:
                handles.setdefault(
                    line.label, Line2D([], [], color=GREY, linestyle=":", label=line.label)
                )
    if panel.level is not None:
        axes.axhline(panel.level[0], color=GREY, linestyle=(0, (6, 3)), linewidth=0.8, zorder=1.5)
        handles[panel.level[1]] = Line2D(
            [], [], color=GREY, linestyle=(0, (6, 3)), linewidth=0.8, label=panel.level[1]
        )
    _scale(axes, panel)
    if handles:
        axes.legend(
            handles=list(handles.values()), loc="best", borderaxespad=0.2, labelspacing=0.25
        )


def _curve(axes: Axes, training: Training, line: Line, look: dict[str, Any], log: bool) -> None:
    values = training.metrics[line.metric] * line.factor
    # What is held at zero for a while has no place on a logarithmic axis.
    there = np.isfinite(values) & ((values > 0.0) | (not log))
    samples, values = training.samples[there] / 1e6, values[there]
    if line.band is not None and all(name in training.metrics for name in line.band):
        low, high = (training.metrics[name][there] * line.factor for name in line.band)
        axes.fill_between(samples, low, high, color=look["color"], alpha=0.13, linewidth=0.0)
    if len(values) < SPARSE:
        axes.plot(samples, values, marker="o", markersize=2.5, **look)
        return
    axes.plot(samples, values, color=look["color"], linewidth=0.6, alpha=0.25)
    axes.plot(samples, smooth(values, max(1, len(values) // SMOOTHED_OVER)), **look)


def _scale(axes: Axes, panel: Panel) -> None:
    if panel.log:
        axes.set_yscale("log")
        axes.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
        axes.yaxis.set_major_formatter(FormatStrFormatter("%g"))
        axes.yaxis.set_minor_formatter(NullFormatter())
    elif panel.limits is not None:
        axes.set_ylim(*panel.limits)
    else:
        low, high = axes.get_ylim()
        axes.set_ylim(min(low, 0.0), high)
    axes.set_xlim(left=0.0)


def _shown(panels: Sequence[Panel], members: Sequence[Training]) -> list[Panel]:
    return [
        panel for panel in panels if any(_expand(panel.lines, training) for training in members)
    ]


def _expand(lines: Sequence[Line], training: Training) -> list[Line]:
    """The lines that a training has metrics for, those with a ``*`` one by one."""
    found = []
    for line in lines:
        if line.metric.endswith("*"):
            stem = line.metric[:-1]
            names = [name for name in training.metrics if name.startswith(stem)]
            labels = [f"{line.label} {name.removeprefix(stem).replace('_', ' ')}" for name in names]
            found += [
                Line(name, label, line.factor) for name, label in zip(names, labels, strict=True)
            ]
        elif line.metric in training.metrics and np.isfinite(training.metrics[line.metric]).any():
            found.append(line)
    return found


def _colour(index: int) -> str:
    return COLOURS[index % len(COLOURS)]
