"""How every picture looks, and how it reaches the disk."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, cast

import matplotlib
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from lacoloco.pipelines.errors import StageError

COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#8C6D31", "#000000")
"""Okabe and Ito's palette, which readers of every colour vision tell apart; its yellow is too pale
for lines.
"""
DASHES = ("-", (0, (4, 1.5)), (0, (1, 1.2)), (0, (5, 1, 1, 1)), (0, (8, 2)))
GREY = "0.45"
STYLE = {
    "font.family": "sans-serif",
    "font.size": 8.0,
    "axes.titlesize": 8.5,
    "axes.titleweight": "bold",
    "axes.labelsize": 8.0,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.linewidth": 0.6,
    "axes.grid": True,
    "grid.color": "0.9",
    "grid.linewidth": 0.5,
    "xtick.labelsize": 7.0,
    "ytick.labelsize": 7.0,
    "xtick.major.width": 0.6,
    "ytick.major.width": 0.6,
    "legend.fontsize": 7.0,
    "legend.edgecolor": "none",
    "legend.framealpha": 0.75,
    "legend.handlelength": 1.8,
    "lines.linewidth": 1.3,
}
DPI = 160


@contextmanager
def paper_style() -> Iterator[None]:
    """Draw in here: matplotlib's own settings are back afterwards."""
    with matplotlib.rc_context(cast("Any", STYLE)):
        yield


def label_y(axes: Axes, title: str, unit: str) -> None:
    """Name a panel and the unit of what it shows."""
    axes.set_title(title, loc="left")
    axes.set_ylabel(unit)


def save(figure: Figure, file: Path) -> Path:
    """Write a picture in one step, in the format that its name ends with.

    Raises:
        StageError: no format of pictures ends like this, or the file system refuses.
    """
    known = figure.canvas.get_supported_filetypes()
    ending = file.suffix.removeprefix(".").lower()
    if ending not in known:
        raise StageError(f"{file}: not a kind of picture; name a .png, .pdf or .svg")
    unfinished = file.with_name(f".{file.name}.part")
    try:
        figure.savefig(unfinished, dpi=DPI, format=ending)
        os.replace(unfinished, file)
    except OSError as error:
        raise StageError(f"{file}: {error.strerror}; name a file in another folder") from error
    finally:
        unfinished.unlink(missing_ok=True)
    return file
