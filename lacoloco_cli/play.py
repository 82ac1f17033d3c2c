"""`lacoloco play`: watch motions and policies."""

from __future__ import annotations

import os
import sys
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Annotated

import typer

from lacoloco_cli import switching
from lacoloco_cli.console import note
from lacoloco_cli.failures import UserError
from lacoloco_cli.option_group import with_options
from lacoloco_cli.options import AT_ONCE, Port
from lacoloco_cli.session import Session, path_text, verb
from lacoloco_cli.video import VideoOptions, draw_video
from lacoloco_cli.written_files import PAGE, check_ending, check_output, copy_to

app = typer.Typer()

PLAYABLE = ("train-high", "train-low", "track", "retarget", "import", "generate")
"""Stages whose newest artifact is played when none is named; the first that has one."""


@verb(app, shared=AT_ONCE)
@with_options(VideoOptions)
def play(
    session: Session,
    options: VideoOptions,
    source: Annotated[
        Path | None,
        typer.Argument(
            metavar="[ARTIFACT]",
            help="Motions, a policy, an earlier playback, a run, or the name of a published one;"
            " default: the policy of the run used last, else its motions.",
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
    port: Port = 0,
    latents: Annotated[
        str | None,
        typer.Option(
            "--latents",
            metavar="random|SEED",
            help="Only the low level: with latents that change at random, or with fixed ones drawn"
            " from a seed, one per episode (what a low level alone does by default).",
        ),
    ] = None,
    figure: Annotated[
        Path | None,
        typer.Option(
            "--figure",
            metavar="FILE",
            help="Instead of a page, the picture of `lacoloco switching`: how a high-level policy"
            " switches skills in one episode.",
        ),
    ] = None,
    motions: Annotated[
        list[Path] | None,
        typer.Option(
            "--motions",
            help="With --figure: motions to compare with; default: those of the policy.",
        ),
    ] = None,
) -> None:
    """Watch a motion or a policy in the browser, or write it as one HTML file or as a film."""
    if figure is not None:
        if html is not None or options.video is not None or clip or latents:
            raise UserError("--figure: is no page; leave out --html, --video, --clip and --latents")
        switching.measure(session, source, motions or [], figure, option="--figure")
        return
    if motions:
        raise UserError("--motions: belongs to --figure; to watch motions, name them alone")
    if options.video is None and options.given():
        named = ", ".join(f"--{name}" for name in options.given())
        raise UserError(f"{named}: of a film; give --video FILE.mp4, the page has its own controls")
    if options.video is not None:
        if html is not None or len(clip or ()) > 1:
            raise UserError("--video: shows one thing; leave out --html, and name one --clip")
        draw_video(session, named_source(session, source), latents_of(latents), options, clip or ())
        return
    write_page(session, source, html, clip or (), latents, port)


def named_source(session: Session, source: Path | None, stages: Sequence[str] = PLAYABLE) -> Path:
    """What is played: an artifact by its path, its folder or its published name, or the newest of a
    run, by its name or its folder; default: of the session's run.

    Args:
        session: The call.
        source: What was named.
        stages: Stages whose newest artifact is taken of a run; the first that has one.

    Raises:
        UserError: The run has nothing to play.
        DatasetError: There is nothing of that name.
    """
    from lacoloco.datasets.beside import ARTIFACT
    from lacoloco.datasets.published import resolve

    if source is None:
        return newest(session, session.run_name, stages)
    if (source / ARTIFACT).is_file():
        return source / ARTIFACT
    run = named_run(session, source)
    return newest(session, run, stages) if run is not None else resolve(source)


def named_run(session: Session, source: Path) -> str | None:
    """The run that is meant by its name or its folder; None for anything else."""
    from lacoloco.datasets.published import find

    store = session.store
    named = source.parent == Path() and find(str(source)) is None
    inside = source.is_dir() and source.resolve().parent == store.root.resolve()
    if not (named or inside) or source.is_file() or source.resolve().name not in store.runs():
        return None
    return source.resolve().name


def write_page(
    session: Session,
    source: Path | None,
    html: Path | None,
    names: Sequence[str],
    latents: str | None,
    port: int = 0,
) -> None:
    """Write the page, and open it where somebody watches."""
    from lacoloco.pipelines import play as stage

    config = replace(session.config(stage.PRESETS), latents=latents_of(latents))
    if session.run is None and source is not None:
        session.run = named_run(session, source)  # its playback belongs to it
    source = named_source(session, source)
    place = page_place(session, html) if html is not None else None
    result = stage.run(config, session.context(), source=source, names=names)
    page = Path(result.metrics["html"])
    if place is not None:
        copy_to("--html", page, place)
    payload = {"artifact": path_text(result.artifact), **result.metrics}
    payload["html"] = str(html or page)
    session.answer(payload, lambda: typer.echo(payload["html"]))
    if html is None and not session.as_json and watched():
        show(page, port)


def page_place(session: Session, html: Path) -> Path:
    """Where the page goes, before the work.

    Raises:
        UserError: It would not be taken for a page there, or something would be lost.
    """
    check_ending("--html", html, ("html", "htm"))
    return check_output("--html", html, PAGE, session.store.root)


def latents_of(text: str | None) -> str:
    """The config's form of `--latents`.

    Raises:
        UserError: Neither `random` nor a seed.
    """
    if text is None or text == "random" or text.isdecimal():
        return text or ""
    raise UserError(f"--latents {text}: use random, or a seed, a whole number from 0")


def newest(session: Session, run: str, stages: Sequence[str] = PLAYABLE) -> Path:
    """What is played of a run by default.

    Raises:
        UserError: The run has nothing to play.
    """
    for stage in stages:
        found = session.store.all(run, stage)
        if found:
            return found[-1]
    if stages != PLAYABLE:
        raise UserError(
            f"run '{run}' has nothing of {' or '.join(stages)}; name an artifact, a run or a"
            " published policy"
        )
    raise UserError(
        f"run '{run}' has nothing to play; name an artifact, or make motions with"
        " `lacoloco retarget`"
    )


def watched() -> bool:
    """Whether a person reads the answer; a script that reads it would wait for a Ctrl-C that nobody
    types.
    """
    return sys.stdout.isatty()


def show(page: Path, port: int = 0) -> None:
    """Show a page in the browser until Ctrl-C; where there is no screen, say where it is.

    Raises:
        StageError: Another program has the port.
    """
    from lacoloco.pipelines.viewing.server import served

    with suppress(KeyboardInterrupt), served(page.read_bytes(), port) as address:
        open_browser(address)
        forever()


def open_browser(address: str) -> None:
    """Say where a page is, and show it where there is a screen and a person at a terminal."""
    import webbrowser

    note(f"{address}  (Ctrl-C ends)")
    screen = sys.platform in ("darwin", "win32")
    screen = screen or bool(os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"))
    if screen and watched():
        webbrowser.open(address)


def forever() -> None:
    """Wait for Ctrl-C."""
    import threading

    threading.Event().wait()
