"""`lacoloco play`: watch motions and policies."""

from __future__ import annotations

import os
import sys
from contextlib import suppress
from pathlib import Path
from typing import Annotated

import typer

from lacoloco_cli.console import note
from lacoloco_cli.failures import UserError
from lacoloco_cli.session import Session, path_text, verb
from lacoloco_cli.written_files import check_writable, copy_to

app = typer.Typer()

PLAYABLE = ("train-high", "retarget", "generate")
"""Stages whose newest artifact is played when none is named; the first that has one."""


@verb(app)
def play(
    session: Session,
    source: Annotated[
        Path | None,
        typer.Argument(
            metavar="[ARTIFACT]",
            help="Motions, a high-level policy or an earlier playback; default: the run's policy,"
            " else its motions.",
        ),
    ] = None,
    clip: Annotated[
        list[str] | None,
        typer.Option("--clip", metavar="NAME", help="Clip to show; may be repeated."),
    ] = None,
    html: Annotated[
        Path | None,
        typer.Option("--html", metavar="FILE", help="Write the page there; open no browser."),
    ] = None,
) -> None:
    """Watch a motion or a policy in the browser, or write it as one HTML file."""
    from lacoloco.pipelines import playback as stage

    config = session.config(stage.PRESETS)
    source = source or newest(session)
    if html is not None:
        check_writable("--html", html)
    result = stage.run(config, session.context(), source=source, names=clip or ())
    page = Path(result.metrics["html"])
    if html is not None:
        copy_to("--html", page, html)
    payload = {"artifact": path_text(result.artifact), **result.metrics}
    payload["html"] = str(html or page)
    session.answer(payload, lambda: typer.echo(payload["html"]))
    if html is None and not session.as_json:
        show(page)


def newest(session: Session) -> Path:
    """What is played by default.

    Raises:
        UserError: The run has nothing to play.
    """
    for stage in PLAYABLE:
        found = session.store.all(session.run_name, stage)
        if found:
            return found[-1]
    raise UserError(
        f"run '{session.run_name}' has nothing to play; name an artifact, or make motions with"
        " `lacoloco retarget`"
    )


def show(page: Path) -> None:
    """Show a page in the browser until Ctrl-C; where there is no screen, say where it is."""
    import webbrowser

    from lacoloco.pipelines.viewing.server import served

    with suppress(KeyboardInterrupt), served(page.read_bytes()) as address:
        note(f"{address}  (Ctrl-C ends)")
        screen = sys.platform in ("darwin", "win32")
        if screen or os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"):
            webbrowser.open(address)
        forever()


def forever() -> None:
    """Wait for Ctrl-C."""
    import threading

    threading.Event().wait()
