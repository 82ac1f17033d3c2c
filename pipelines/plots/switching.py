"""One episode of the reach task, skill by skill, above what all episodes do: the paper's figures of
skill switching.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from lacoloco.pipelines.plots.style import COLOURS, GREY, paper_style, save

if TYPE_CHECKING:
    from lacoloco.pipelines.evaluation.rollout import ReachRecording
    from lacoloco.pipelines.evaluation.skill_switching import Switching

SIZE = (6.6, 7.2)
HEIGHTS = (1.5, 0.3, 1.1, 1.1, 0.9, 0.9)


def draw_switching(
    file: Path, found: Switching, played: ReachRecording, shown: int, feet: Sequence[str]
) -> None:
    """Draw latent, nearest clip, distances, error and contacts of episode ``shown``, and the skills
    of all episodes.

    Raises:
        StageError: the picture cannot be written.
    """
    edges = np.arange(found.nearest.shape[1] + 1) / found.fps
    time = edges[1:]
    colours = dict(zip(found.skills, COLOURS, strict=False))
    with paper_style():
        figure = Figure(figsize=SIZE, layout="constrained")
        panels = figure.subplots(len(HEIGHTS), 1, sharex=True, height_ratios=HEIGHTS)
        latent, strip, distance, error, contact, everyone = panels
        _latent(figure, latent, edges, played.steering[shown])
        _strip(strip, edges, found, shown, colours)
        for index, skill in enumerate(found.skills):
            values = found.distances[shown, :, index]
            distance.plot(
                time, values, color=colours[skill], linewidth=1.0, label=f"nearest {skill} clip"
            )
        _finish(distance, "distance to clips\n[std]", legend=True)
        error.plot(time, 100.0 * found.error[shown], color="black")
        error.annotate(
            f"{100.0 * found.error[shown, -1]:.1f} cm",
            (time[-1], 100.0 * found.error[shown, -1]),
            (-4, 5),
            textcoords="offset points",
            ha="right",
        )
        _finish(error, "end effector to\ntarget [cm]")
        _contacts(contact, edges, played.contact[shown], feet)
        _everyone(everyone, time, found, colours)
        everyone.set_xlabel("time [s]")
        everyone.set_xlim(edges[0], edges[-1])
        share = found.metrics()["walk_first_reach_last"]
        title = (
            f"Episode {shown}; {share:.1%} of {len(found.fell)} episodes walk first and reach last"
        )
        figure.suptitle(title, x=0.01, ha="left", fontsize=9.5, fontweight="bold")
        figure.align_ylabels(panels)
        save(figure, file)


def _latent(figure: Figure, axes: Axes, edges: np.ndarray, latent: np.ndarray) -> None:
    rows = np.arange(latent.shape[1] + 1) + 0.5
    mesh = axes.pcolormesh(
        edges, rows, latent.T, cmap="RdBu_r", vmin=-1.0, vmax=1.0, rasterized=True
    )
    axes.set_yticks(rows[:-1] + 0.5)
    axes.invert_yaxis()
    axes.set_ylabel("latent component")
    axes.grid(visible=False)
    figure.colorbar(mesh, ax=axes, pad=0.01, ticks=(-1, 0, 1), aspect=12)


def _strip(
    axes: Axes, edges: np.ndarray, found: Switching, shown: int, colours: dict[str, str]
) -> None:
    for index, skill in enumerate(found.skills):
        bars = _bars(edges, found.nearest[shown] == index)
        axes.broken_barh(bars, (0, 1), color=colours[skill], linewidth=0.0)
        if bars:
            begin, length = max(bars, key=lambda bar: bar[1])
            axes.text(
                begin + 0.5 * length,
                0.5,
                skill,
                color="white",
                ha="center",
                va="center",
                clip_on=True,
            )
    axes.set_ylim(0, 1)
    axes.set_yticks([])
    axes.set_ylabel("nearest\nclip")
    axes.grid(visible=False)


def _contacts(axes: Axes, edges: np.ndarray, contact: np.ndarray, feet: Sequence[str]) -> None:
    for row, touches in enumerate(contact.T):
        axes.broken_barh(_bars(edges, touches), (row - 0.35, 0.7), color="0.25", linewidth=0.0)
    axes.set_yticks(range(len(feet)), [foot.removesuffix("_FOOT") for foot in feet])
    axes.set_ylim(len(feet) - 0.5, -0.5)
    axes.set_ylabel("feet on the\nground")
    axes.grid(visible=False)


def _everyone(axes: Axes, time: np.ndarray, found: Switching, colours: dict[str, str]) -> None:
    shares = [100.0 * (found.nearest == index).mean(axis=0) for index in range(len(found.skills))]
    axes.stackplot(
        time, shares, colors=[colours[skill] for skill in found.skills], alpha=0.75, linewidth=0.0
    )
    axes.set_ylim(0, 100)
    axes.set_ylabel("all episodes,\nnearest [%]")
    axes.grid(visible=False)


def _finish(axes: Axes, label: str, legend: bool = False) -> None:
    axes.set_ylabel(label)
    axes.set_ylim(bottom=0.0)
    axes.axhline(0.0, color=GREY, linewidth=0.5)
    if legend:
        axes.legend(loc="upper right", ncols=4)


def _bars(edges: np.ndarray, on: np.ndarray) -> list[tuple[float, float]]:
    """(start, length) of every run of true values."""
    change = np.flatnonzero(np.diff(np.r_[False, on, False].astype(np.int8)))
    return [(edges[begin], edges[end] - edges[begin]) for begin, end in change.reshape(-1, 2)]
