"""Several trainings of one experiment, each in a job of its own, and how far they are."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import typer

from lacoloco_cli import console
from lacoloco_cli.failures import OUR_BUG, UserError
from lacoloco_cli.session import Session, path_text

if TYPE_CHECKING:
    from lacoloco.pipelines.chains.chain_stages import Outcome
    from lacoloco.pipelines.chains.sweep import Asked, Trial
    from lacoloco.pipelines.chains.variants import Variant

STATUSES = ("done", "failed", "unfinished", "missing")


@dataclass(frozen=True)
class Sweep:
    """What was asked for with `--methods`, `--sweep` or `--executor`, or as `table-1`.

    Attributes:
        name: Of the experiment, or `table-1`.
        variants: What is compared.
        asked: What all of them share.
        seeds: Per variant.
        executor: `local` or `slurm`.
        jobs: At most so many at the same time; None: 1, on Slurm all.
        slurm: `"KEY=VALUE"`.
    """

    name: str
    variants: list[Variant]
    asked: Asked
    seeds: int
    executor: str
    jobs: int | None
    slurm: list[str]

    def at_once(self) -> int:
        """Jobs at the same time."""
        every = len(self.variants) * self.seeds
        return self.jobs or (1 if self.executor == "local" else every)


def run_sweep(session: Session, many: Sweep, *, status: bool) -> None:
    """Train every trial that is missing, or only show how far they are.

    Raises:
        typer.Exit: With code 1 when a trial failed; the others are done all the same.
    """
    from lacoloco.pipelines.chains import sweep

    evaluation = None
    if status:
        found = sweep.trials(session.context(), many.variants, many.seeds, many.asked)
    else:
        given, context = parameters(many.slurm), session.context()
        session.remember()
        found, evaluation = sweep.run_trials(
            context,
            many.variants,
            many.seeds,
            many.asked,
            executor=many.executor,
            at_once=many.at_once(),
            options=given,
        )
    _answer(session, many, found, evaluation)


def _answer(
    session: Session, many: Sweep, found: Sequence[Trial], evaluation: Outcome | None
) -> None:
    rows = [trial_row(trial) for trial in found]
    payload: dict[str, Any] = {
        "artifact": path_text(evaluation.artifact) if evaluation else None,
        "experiment": many.name,
        "run": session.run_name,
        "trials": rows,
        "counts": {kind: [r["status"] for r in rows].count(kind) for kind in STATUSES},
    }

    def show() -> None:
        columns = ("variant", "seed", "status", "samples", "seconds", "error")
        table = [[row[column] for column in columns] for row in rows]
        console.print_table(list(columns), table)
        if evaluation:
            typer.echo(f"evaluation: {evaluation.summary}; {path_text(evaluation.artifact)}")
            typer.echo(f"as a table: lacoloco runs report {session.run_name}")

    session.answer(payload, show)
    if payload["counts"]["failed"]:
        raise typer.Exit(OUR_BUG)


def trial_row(trial: Trial) -> dict[str, Any]:
    """One trial as `--json` prints it."""
    paths = {stage: getattr(trial, stage) for stage in ("low", "high")}
    return {
        "variant": trial.variant.name,
        "method": trial.variant.method,
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
