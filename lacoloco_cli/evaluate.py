"""`lacoloco eval`: the paper's Table I for the policies of a run."""

from __future__ import annotations

import shlex
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any, Literal

import typer

from lacoloco_cli import console
from lacoloco_cli.failures import UserError
from lacoloco_cli.options import AT_ONCE, Seeds
from lacoloco_cli.policy_choice import missing, train_missing, trained
from lacoloco_cli.report_table import first_heading, row_name
from lacoloco_cli.session import Session, path_text, verb
from lacoloco_cli.written_files import PICTURES, check_ending, check_output

app = typer.Typer()

COLUMNS = {
    "method": "method",
    "seed": "seed",
    "episodes": "episodes",
    "ee_error_mean_m": "error m",
    "ee_error_std_m": "std m",
    "ee_error_median_m": "median m",
    "contact_violation_pct": "violation %",
    "contact_violation_original_pct": "as the original %",
    "falls_pct": "falls %",
    "not_reached_pct": "not reached %",
    "success_5cm_pct": "within 5 cm %",
    "success_30cm_pct": "within 30 cm %",
}
"""Key of a row -> heading."""
SHIFT_COLUMNS = {
    "name": "name",
    "episodes": "episodes",
    "success_5cm_pct": "within 5 cm %",
    "success_30cm_pct": "within 30 cm %",
    "ee_error_median_m": "median m",
    "ee_error_mean_m": "error m",
    "falls_pct": "falls %",
    "contact_violation_pct": "violation %",
    "contact_violation_original_pct": "as the original %",
}
"""The same for a row of the hardware shift."""
REWARD_COLUMNS = {
    "method": "method",
    "seed": "seed",
    "episodes": "episodes",
    "task": "task",
    "task_reward": "reward 1/s",
    "contact_violation_pct": "violation %",
    "contact_violation_original_pct": "as the original %",
    "falls_pct": "falls %",
}
"""The same for policies of a task without a target."""


@verb(app, shared=AT_ONCE)
def evaluate(
    session: Session,
    policy: Annotated[
        list[Path] | None,
        typer.Option(
            "--policy",
            help="High-level policy, or its published name; may be repeated. Default: the run's.",
        ),
    ] = None,
    episodes: Annotated[
        int | None, typer.Option("--episodes", min=1, help="Reported episodes per policy.")
    ] = None,
    protocol: Annotated[
        Literal["development", "fresh"] | None,
        typer.Option(
            "--protocol",
            help="Which episodes: those of development, or fresh ones that nothing was tuned on.",
        ),
    ] = None,
    shift: Annotated[
        Literal["hardware"] | None,
        typer.Option(
            "--shift",
            help="Play the same episodes again with one effect of real hardware at a time.",
        ),
    ] = None,
    figure: Annotated[
        Path | None,
        typer.Option("--figure", metavar="FILE", help="Picture of --shift: .png, .pdf or .svg."),
    ] = None,
    seeds: Seeds = 1,
    fill: Annotated[
        bool, typer.Option("--train-missing", help="Train the seeds that are not there yet.")
    ] = False,
) -> None:
    """Measure error, falls and constraint violations; choose the best on other episodes."""
    from lacoloco.datasets.published import resolve
    from lacoloco.pipelines import evaluate as stage

    config = session.config(stage.PRESETS)
    if episodes is not None:
        config = replace(config, episodes=episodes)
    if protocol is not None:
        config = replace(config, protocol=protocol)
    if shift is not None:
        config = replace(config, shift=shift)
    place = figure_place(session, figure, config.shift)
    coverage: dict[str, Any] = {}
    if policy is None:
        policy, coverage = policies_of_run(session, seeds, fill)
    policy = session.takes(*(resolve(one) for one in policy))
    result = stage.run(config, session.context(), policies=policy)
    answer = {"artifact": path_text(result.artifact), **result.metrics, **coverage}
    if place is not None and figure is not None:
        from lacoloco.pipelines.plots.shift import draw_shift

        draw_shift(place, result.metrics["shift"])
        answer["figure"] = path_text(figure)
    session.answer(answer, lambda: show(answer))
    if coverage.get("train_missing"):
        console.note(
            f"WARNING: {coverage['seeds_found']} of {coverage['seeds_asked']} seeds are trained; "
            f"train the rest with: {coverage['train_missing']}"
        )


def figure_place(session: Session, figure: Path | None, shift: str) -> Path | None:
    """Where the picture goes, before the work.

    Raises:
        UserError: There will be nothing to draw, or something would be lost there.
    """
    if figure is None:
        return None
    if not shift:
        raise UserError("--figure draws the table of --shift; give both")
    kind = check_ending("--figure", figure, PICTURES)
    return check_output("--figure", figure, kind, session.store.root)


def policies_of_run(session: Session, seeds: int, fill: bool) -> tuple[list[Path], dict[str, Any]]:
    """Choose the run's policies with the seeds asked for, and say which are not there.

    One seed means the newest policy, whatever its seed; several mean those counted up from
    `--seed`, of every method in the run.

    Returns:
        Paths, and `seeds_asked`, `seeds_found` (of the method with the fewest) and, when some are
        missing, the command `train_missing`.

    Raises:
        ArtifactError: The run has no policy at all.
    """
    newest = session.store.newest(session.run_name, "train-high")
    if seeds == 1:
        return [newest], {"seeds_asked": 1, "seeds_found": 1}
    asked = range(session.seed, session.seed + seeds)
    found = trained(session, "train-high")
    absent = missing(found, asked)
    if fill:
        for method, seed in absent:
            session.progress.say(f"training {method} seed {seed}, which the run does not have")
            train_missing(session, method, seed)
        found, absent = trained(session, "train-high"), []
    most_absent = max(Counter(method for method, _ in absent).values(), default=0)
    coverage: dict[str, Any] = {"seeds_asked": seeds, "seeds_found": seeds - most_absent}
    if absent:
        options = ["--run", session.run_name, "--seeds", str(seeds), "--train-missing"]
        coverage["train_missing"] = shlex.join(["lacoloco", "eval", *options])
    return [one.header.path for one in found if one.seed in asked] or [newest], coverage


def show(answer: Mapping[str, Any]) -> None:
    """Print a row per policy, its failure analysis, mean and spread over seeds, and the best."""
    from lacoloco.pipelines.evaluation.failure_analysis import describe

    rows = answer["rows"]
    columns = REWARD_COLUMNS if "task_reward" in rows[0] else COLUMNS
    named = [{**row, "method": row_name(row)} for row in rows]
    headings = [first_heading(rows), *list(columns.values())[1:]]
    console.print_table(headings, [[row[key] for key in columns] for row in named])
    if columns is COLUMNS:
        show_intervals(rows)
    for row in rows:
        if row.get("diverged"):
            console.note(
                f"WARNING: {row_name(row)} seed {row['seed']}: {row['diverged']} worlds diverged;"
                " they count as falls, and errors are those of the others"
            )
    for row in rows if columns is COLUMNS else ():
        who = f"{row_name(row)} seed {row['seed']}"
        if row["not_reached"]:
            typer.echo(
                f"{who}, not reached: {row['no_progress']} of {row['not_reached']} make no progress"
            )
        for cluster in row["failure_clusters"]:
            typer.echo(f"{who}, {describe(cluster)}")
    if "shift" in answer:
        show_shift(answer["shift"])
    for method, spread in answer["summary"].items():
        if spread["seeds"] > 1:
            measured = (
                f"error {_spread(spread, 'ee_error_mean_m')} m"
                if columns is COLUMNS
                else f"reward {_spread(spread, 'task_reward')} 1/s"
            )
            typer.echo(
                f"{method}, {spread['seeds']} seeds: {measured}, "
                f"violation {_spread(spread, 'contact_violation_pct')} %, "
                f"falls {_spread(spread, 'falls_pct')} %"
            )
    best = answer["best"]
    if len(rows) > 1:
        typer.echo(f"best on other episodes: {row_name(best)} seed {best['seed']}")
    typer.echo(f"artifact: {answer['artifact']}")


def show_shift(rows: Sequence[Mapping[str, Any]]) -> None:
    """Print a line per row of the hardware shift."""
    cells = [[row[key] for key in SHIFT_COLUMNS] for row in rows]
    console.print_table(list(SHIFT_COLUMNS.values()), cells, title="hardware shift")


def show_intervals(rows: Sequence[Mapping[str, Any]]) -> None:
    """Print the 95 % intervals over the episodes, one line per policy."""
    shown = {key: heading for key, heading in COLUMNS.items() if key in rows[0]["intervals"]}
    cells = [
        [
            row_name(row),
            row["seed"],
            *(" to ".join(f"{edge:.4g}" for edge in row["intervals"][key]) for key in shown),
        ]
        for row in rows
    ]
    console.print_table(
        [first_heading(rows), "seed", *shown.values()],
        cells,
        title="95 % intervals over the episodes",
    )


def _spread(spread: Mapping[str, Any], name: str) -> str:
    low, high = spread[f"{name}_interval"]
    return (
        f"{spread[f'{name}_mean']:.4g} +- {spread[f'{name}_spread']:.2g}"
        f" (95 % of the mean: {low:.4g} to {high:.4g})"
    )
