"""Success under the hardware shift, row by row, as bars."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from lacoloco.pipelines.plots.style import COLOURS, paper_style, save

WIDTH, ROW_HEIGHT = 6.0, 0.2
SUCCESS = {"success_5cm_pct": "within 5 cm", "success_30cm_pct": "within 30 cm"}


def draw_shift(file: Path, rows: Sequence[Mapping[str, Any]]) -> None:
    """Draw the share of the episodes that end near the target, with its 95 % interval.

    Args:
        file: Where the picture goes.
        rows: From :func:`lacoloco.pipelines.evaluation.hardware_shift.hardware_shift`.

    Raises:
        StageError: the picture cannot be written.
    """
    places = np.arange(len(rows))
    with paper_style():
        figure = Figure(figsize=(WIDTH, 1.0 + ROW_HEIGHT * len(rows)), layout="constrained")
        axes = figure.subplots()
        for index, (key, label) in reversed(list(enumerate(SUCCESS.items()))):
            values = np.array([row[key] for row in rows])
            edges = np.array([row["intervals"][key] for row in rows]).T
            near = index == 0
            axes.barh(
                places,
                values,
                0.5 if near else 0.8,
                color=COLOURS[0 if near else 5],
                label=label,
                xerr=np.abs(edges - values) if near else None,
                error_kw={"elinewidth": 0.8},
            )
        axes.set_yticks(places, [row["name"] for row in rows])
        axes.invert_yaxis()
        axes.set_xlim(0.0, 100.0)
        axes.set_xlabel(f"episodes [%], {rows[0]['episodes']} in each row")
        axes.grid(axis="y", visible=False)
        figure.legend(loc="outside upper right", ncols=2)
        save(figure, file)
