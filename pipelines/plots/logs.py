"""The logs of all trainings of a run, complete and unfinished, as columns."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from lacoloco.datasets.store import RunStore
from lacoloco.pipelines.errors import StageError

LOG = "metrics.jsonl"


@dataclass(frozen=True)
class Training:
    """One training.

    Attributes:
        stage: verb that trained it.
        label: tells it from the others, e.g. ``0002 drail-cat seed 0``.
        samples: (n,) control steps at each logged iteration.
        metrics: name -> (n,) values, NaN where an iteration has none.
    """

    stage: str
    label: str
    samples: np.ndarray
    metrics: dict[str, np.ndarray]


def trainings(store: RunStore, run: str) -> list[Training]:
    """Every training that a run's logs hold, stage by stage, oldest first.

    Raises:
        StageError: the run has none, or a log cannot be read.
    """
    found = []
    for stage in store.stages(run):
        folders = [(path.parent, path.parent.name) for path in store.all(run, stage)]
        folders += [
            (part.path, f"{part.final.name} (unfinished)") for part in store.partials(run, stage)
        ]
        for folder, version in sorted(folders, key=lambda item: item[1]):
            if (folder / LOG).is_file():
                found += _read(folder / LOG, stage, version)
    if not found:
        known = ", ".join(store.runs()) or "none"
        raise StageError(f"run '{run}' has no log of a training in {store.root}; runs: {known}")
    return found


def _read(log: Path, stage: str, version: str) -> list[Training]:
    try:
        lines = log.read_text(encoding="utf-8").splitlines()
    except (OSError, UnicodeDecodeError) as error:
        raise StageError(f"{log}: cannot be read ({error})") from error
    rows: dict[str, list[dict[str, float]]] = {}
    for number, line in enumerate(lines, 1):
        try:
            row = json.loads(line)
            rows.setdefault(row.pop("training"), []).append(row)
        except (ValueError, KeyError, AttributeError) as error:
            if number == len(lines):  # a running or a killed training was about to write it
                continue
            raise StageError(f"{log}: line {number} is damaged; delete that line") from error
    return [_training(name, stage, version, logged) for name, logged in rows.items()]


def _training(name: str, stage: str, version: str, rows: list[dict[str, float]]) -> Training:
    names = dict.fromkeys(figure for row in rows for figure in row)
    columns = {
        figure: np.array([row.get(figure, np.nan) for row in rows], float) for figure in names
    }
    samples = columns.pop("samples")
    order = np.argsort(
        samples, kind="stable"
    )  # a resumed training may log after another one of its directory
    metrics = {figure: values[order] for figure, values in columns.items()}
    return Training(stage, f"{version} {name.removeprefix(stage).strip()}", samples[order], metrics)
