"""`lacoloco run --methods ... --executor ...`: many trainings of one experiment, and how far they
are.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

from lacoloco_cli import console
from lacoloco_cli.failures import OUR_BUG, UserError
from lacoloco_cli.session import Session, path_text

if TYPE_CHECKING:
    from lacoloco.pipelines.chains.sweep import Trial

STATUSES = ("done", "failed", "unfinished", "missing")


@dataclass(frozen=True)
class Sweep:
    """What was asked for with `--methods` or `--executor`."""

    experiment: str
    methods: str
    seeds: int
    executor: str
    jobs: int | None
    slurm: list[str]
    mocap: list[Path]
    settings: Mapping[str, Mapping[str, Any]]
    """Stage -> dotted path of a config field -> value."""
    robot: str | None = None


def run_sweep(session: Session, asked: Sweep, *, status: bool) -> None:
    """Train every trial that is missing, or only show how far they are.

    Raises:
        typer.Exit: With code 1 when a trial failed; the others are done all the same.
    """
    from lacoloco.pipelines.chains import sweep

    methods = sweep.chosen_methods(asked.methods)
    evaluation = None
    if status:
        seeds = range(session.seed, session.seed + asked.seeds)
        found = sweep.trials(session.store, session.run_name, methods, seeds)
    else:
        at_once = asked.jobs or (1 if asked.executor == "local" else len(methods) * asked.seeds)
        given, context = parameters(asked.slurm), session.context()
        session.remember()
        found, evaluation = sweep.run_trials(
            asked.experiment,
            context,
            preset=session.preset or "laptop",
            methods=methods,
            seeds=asked.seeds,
            executor=asked.executor,
            at_once=at_once,
            options=given,
            mocap=asked.mocap,
            settings=asked.settings,
            robot=asked.robot,
        )
    rows = [trial_row(trial) for trial in found]
    payload: dict[str, Any] = {
        "artifact": path_text(evaluation.artifact) if evaluation else None,
        "experiment": asked.experiment,
        "run": session.run_name,
        "trials": rows,
        "counts": {kind: [r["status"] for r in rows].count(kind) for kind in STATUSES},
    }

    def show() -> None:
        columns = ("method", "seed", "status", "samples", "seconds", "error")
        table = [[row[column] for column in columns] for row in rows]
        console.print_table(list(columns), table)
        if evaluation:
            typer.echo(f"evaluation: {evaluation.summary}; {path_text(evaluation.artifact)}")

    session.answer(payload, show)
    if payload["counts"]["failed"]:
        raise typer.Exit(OUR_BUG)


def trial_row(trial: Trial) -> dict[str, Any]:
    """One trial as `--json` prints it."""
    paths = {stage: getattr(trial, stage) for stage in ("low", "high")}
    return {
        "method": trial.method,
        "seed": trial.seed,
        "status": trial.status,
        "samples": trial.samples,
        "seconds": trial.seconds,
        "error": trial.error,
        **{stage: path_text(path) if path else None for stage, path in paths.items()},
    }


def parameters(assignments: Iterable[str]) -> dict[str, str]:
    """Read `KEY=VALUE`s.

    Raises:
        UserError: One without an equals sign.
    """
    pairs = [assignment.partition("=") for assignment in assignments]
    for key, equals, value in pairs:
        if not key or not equals:
            raise UserError(f"--slurm {key}{equals}{value}: write it as KEY=VALUE")
    return {key.strip(): value.strip() for key, _, value in pairs}
