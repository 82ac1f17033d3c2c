"""`lacoloco runs page`: a run as one HTML page."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from lacoloco_cli.options import READING, RunNamed
from lacoloco_cli.session import Session, path_text, verb
from lacoloco_cli.written_files import RUN_PAGE, check_ending, check_output

app = typer.Typer()

NAME = "page.html"


@verb(app, "page", shared=READING)
def page_of_run(
    session: Session,
    run: RunNamed = None,
    out: Annotated[
        Path | None,
        typer.Option("--out", metavar="FILE", help="An .html; default: runs/RUN/page.html."),
    ] = None,
) -> None:
    """Write a run as one page: stages, results, curves, figures, playback and lineage."""
    from lacoloco.datasets.atomic_write import write_file
    from lacoloco.pipelines import train_high, train_low
    from lacoloco.pipelines.viewing.gallery import build_run_page

    run = run or session.run_name
    usual = session.store.directory(run) / NAME
    place = out = out or usual
    if out.absolute() != usual.absolute():  # the one page that belongs among the runs
        check_ending("--out", out, ("html", "htm"))
        place = check_output("--out", out, RUN_PAGE, session.store.root)
    shown = {"train-low": train_low.LOG_KEYS, "train-high": train_high.LOG_KEYS}
    content = build_run_page(session.store, run, shown).encode()
    write_file(place, content, replace=True)
    payload = {"page": path_text(out), "run": run, "bytes": len(content)}
    session.answer(payload, lambda: typer.echo(payload["page"]))
