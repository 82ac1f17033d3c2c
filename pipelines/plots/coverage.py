"""What clips show and what held latents make of it, in the planes of velocities and height."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from lacoloco.pipelines.evaluation.skill_cells import (
    AXES,
    FORWARD,
    LATERAL,
    LIFT,
    UNITS,
    YAW,
    CellCoverage,
)
from lacoloco.pipelines.plots.style import COLOURS, paper_style, save

SIZE = (7.2, 5.0)
PLANES = ((LATERAL, FORWARD), (YAW, FORWARD), (LIFT, FORWARD))
"""Axes across and up of each column."""
LABELS = {"forward": "forward", "lateral": "to the left", "yaw": "turning left", "lift": "lift"}
BEYOND = 1
"""Cells that are shown beyond those of the clips; what lies further out is drawn at the border."""


def draw_coverage(file: Path, found: CellCoverage) -> None:
    """Draw the clips' moments, told apart by whether a latent reaches their cell, above the held
    latents.

    Raises:
        StageError: the picture cannot be written.
    """
    metrics, reached = found.metrics(), found.reached().cpu().numpy()
    clips, latents = found.clips.cpu().numpy(), found.latents.cpu().numpy()
    numbers = found.cells.index(found.clips)
    low = (numbers.amin(dim=0) - BEYOND).tolist()
    low[LIFT] = 0
    high = (numbers.amax(dim=0) + BEYOND).tolist()
    edges = [found.cells.edges(axis, low[axis], high[axis]) for axis in range(len(AXES))]
    fell = found.held - len(latents)
    with paper_style():
        figure = Figure(figsize=SIZE, layout="constrained")
        rows = figure.subplots(2, len(PLANES), sharex="col", sharey=True)
        for (across, up), column in zip(PLANES, rows.T, strict=True):
            plane = edges[across], edges[up]
            for axes, motion in zip(column, (clips, latents), strict=True):
                _cells(axes, motion[:, [across, up]], plane)
            for mask, colour, label in (
                (reached, COLOURS[0], "a latent reaches its cell"),
                (~reached, COLOURS[1], "no latent does"),
            ):
                _dots(column[0], clips[mask][:, [across, up]], plane, colour, label)
            _dots(column[1], latents[:, [across, up]], plane, "black", "held latents")
            column[1].set_xlabel(_label(across))
        for axes, name in zip(rows[:, 0], ("moments of the clips", "held latents"), strict=True):
            axes.set_ylabel(f"{name}\n{_label(FORWARD)}")
        rows[0, 0].legend(loc="lower left")
        tail = f"; {fell} fell" if fell else ""
        figure.suptitle(
            f"{found.held} latents reach {metrics['coverage_cells']:.0%} of what the clips show,"
            f" as many moments of the clips {metrics['clips_cells']:.0%}{tail}",
            x=0.01,
            ha="left",
            fontsize=9.5,
            fontweight="bold",
        )
        save(figure, file)


def _cells(axes: Axes, motion: np.ndarray, plane: tuple[Sequence[float], Sequence[float]]) -> None:
    """Shade each cell by the square root of its share, and draw the edges."""
    inside = _clamped(motion, plane)
    counts = np.histogram2d(inside[:, 0], inside[:, 1], bins=[np.array(e) for e in plane])[0]
    shares = counts / max(1, len(motion))
    axes.pcolormesh(*plane, np.sqrt(shares.T), cmap="Greys", vmin=0.0, vmax=1.5, rasterized=True)
    axes.set_xticks(plane[0], minor=True)
    axes.set_yticks(plane[1], minor=True)
    axes.grid(visible=False)
    axes.grid(which="minor", color="0.75", linewidth=0.5)
    axes.tick_params(which="minor", length=0)
    axes.set_xlim(plane[0][0], plane[0][-1])
    axes.set_ylim(plane[1][0], plane[1][-1])


def _dots(
    axes: Axes,
    motion: np.ndarray,
    plane: tuple[Sequence[float], Sequence[float]],
    colour: str,
    label: str,
) -> None:
    axes.plot(*_clamped(motion, plane).T, ".", color=colour, markersize=2.5, label=label)


def _clamped(motion: np.ndarray, plane: tuple[Sequence[float], Sequence[float]]) -> np.ndarray:
    """(n, 2) motions, those outside of the plane at its border."""
    low, high = np.array([(edges[0], edges[-1]) for edges in plane]).T
    return np.clip(motion, low, high)


def _label(axis: int) -> str:
    return f"{LABELS[AXES[axis]]} [{UNITS[axis]}]"
