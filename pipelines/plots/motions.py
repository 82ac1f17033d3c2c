"""What is in a library of motions, as one picture."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from lacoloco.datasets import rotations
from lacoloco.datasets.clip import Clip
from lacoloco.pipelines.plots.style import COLOURS, paper_style, save

SIZE = (7.2, 5.4)
BINS = 40
MOST_PATHS = 120
"""Paths that are drawn, spread over the library; more hide each other."""
OTHERS = "others"


def draw_motions(file: Path, clips: Sequence[Clip], statistics: dict[str, Any], title: str) -> None:
    """Draw speeds and turning of each clip, paths from above, base heights, and durations.

    Args:
        file: Where the picture goes.
        clips: At least one.
        statistics: From :func:`lacoloco.datasets.motion_statistics.library_statistics`.
        title: Of the picture.

    Raises:
        StageError: The picture cannot be written.
    """
    skills = _colours(statistics["skills"])
    rows = statistics["clips"]
    kinds = [row["skill"] if row["skill"] in skills else OTHERS for row in rows]
    with paper_style():
        figure = Figure(figsize=SIZE, layout="constrained")
        figure.suptitle(title, fontsize=9.0)
        speeds, paths, heights, lengths = figure.subplots(2, 2).flat
        for skill, colour in skills.items():
            chosen = [row for row, kind in zip(rows, kinds, strict=True) if kind == skill]
            speeds.scatter(
                [row["forward_mean_m_s"] for row in chosen],
                [row["turning_mean_rad_s"] for row in chosen],
                s=10.0,
                color=colour,
                alpha=0.7,
                linewidths=0.0,
                label=f"{skill or 'no skill'} ({len(chosen)})",
            )
        _name(speeds, "each clip: forward speed and turning", "m/s", "rad/s")
        speeds.legend(loc="best")
        _draw_paths(paths, clips, kinds, skills)
        _draw_heights(heights, clips, kinds, skills)
        lengths.hist([row["seconds"] for row in rows], BINS, color=COLOURS[0])
        _name(lengths, "durations", "s", "clips")
        save(figure, file)


def _colours(skills: Sequence[dict[str, Any]]) -> dict[str, str]:
    """Skill -> colour, most seconds first; what has no colour left is together."""
    ordered = sorted(skills, key=lambda row: -row["seconds"])
    named = ordered if len(ordered) <= len(COLOURS) else ordered[: len(COLOURS) - 1]
    colours = {row["skill"]: COLOURS[index] for index, row in enumerate(named)}
    return colours if len(named) == len(ordered) else {**colours, OTHERS: COLOURS[-1]}


def _draw_paths(
    axes: Axes, clips: Sequence[Clip], kinds: Sequence[str], colours: dict[str, str]
) -> None:
    chosen = np.unique(np.linspace(0, len(clips) - 1, MOST_PATHS).round().astype(int))
    for index in chosen.tolist():
        clip = clips[index]
        heading = rotations.from_yaw(rotations.yaw(clip.root_quat[:1].astype(float)))
        path = rotations.rotate_inverse(heading, clip.root_pos - clip.root_pos[:1])
        axes.plot(path[:, 0], path[:, 1], color=colours[kinds[index]], linewidth=0.7, alpha=0.6)
    axes.set_aspect("equal", adjustable="datalim")
    shown = "" if len(chosen) == len(clips) else f" ({len(chosen)} of {len(clips)})"
    _name(axes, f"paths from above{shown}", "m, along the first heading", "m")


def _draw_heights(
    axes: Axes, clips: Sequence[Clip], kinds: Sequence[str], colours: dict[str, str]
) -> None:
    heights: dict[str, list[np.ndarray]] = {skill: [] for skill in colours}
    for clip, kind in zip(clips, kinds, strict=True):
        heights[kind].append(clip.root_pos[:, 2])
    together = {skill: np.concatenate(parts) for skill, parts in heights.items() if parts}
    axes.hist(
        list(together.values()),
        BINS,
        weights=[
            np.full(len(part), 1.0 / sum(map(len, together.values()))) for part in together.values()
        ],
        color=[colours[skill] for skill in together],
        stacked=True,
    )
    _name(axes, "height of the base", "m", "share of the frames")


def _name(axes: Axes, title: str, x: str, y: str) -> None:
    axes.set_title(title, loc="left")
    axes.set_axisbelow(True)
    axes.set_xlabel(x)
    axes.set_ylabel(y)
