"""`lacoloco runs plot`: the curves of a run's trainings as one picture."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from lacoloco_cli.options import READING, RunNamed
from lacoloco_cli.session import Session, path_text, verb
from lacoloco_cli.written_files import PICTURES, check_ending, check_output

app = typer.Typer()

PICTURE = "curves.png"


@verb(app, "plot", shared=READING)
def plot_run(
    session: Session,
    run: RunNamed = None,
    out: Annotated[
        Path | None,
        typer.Option(
            "--out", metavar="FILE", help="A .png, .pdf or .svg; default: runs/RUN/curves.png."
        ),
    ] = None,
) -> None:
    """Draw the curves of all trainings of a run, also of unfinished ones, as one picture."""
    from lacoloco.pipelines.plots.curves import plot_run

    run = run or session.run_name
    usual = session.store.directory(run) / PICTURE
    place = out = out or usual
    if out.absolute() != usual.absolute():  # the one picture that belongs among the runs
        place = check_output("--out", out, check_ending("--out", out, PICTURES), session.store.root)
    drawn = plot_run(session.store, run, place)
    payload = {"picture": path_text(out), "run": run, "trainings": drawn}
    session.answer(payload, lambda: typer.echo(payload["picture"]))
