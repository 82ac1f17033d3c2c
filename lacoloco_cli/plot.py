"""`lacoloco runs plot`: the curves of a run's trainings as one picture."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from lacoloco_cli.options import READING
from lacoloco_cli.session import Session, path_text, verb
from lacoloco_cli.written_files import check_writable

app = typer.Typer()

PICTURE = "curves.png"


@verb(app, "plot", shared=READING)
def plot_run(
    session: Session,
    run: Annotated[
        str | None, typer.Argument(metavar="[RUN]", help="Default: the run used last.")
    ] = None,
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
    out = out or session.store.directory(run) / PICTURE
    if out.parent.is_dir():  # a run that is not there is named below
        check_writable("--out", out)
    drawn = plot_run(session.store, run, out)
    payload = {"picture": path_text(out), "run": run, "trainings": drawn}
    session.answer(payload, lambda: typer.echo(payload["picture"]))
