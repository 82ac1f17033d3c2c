"""`lacoloco explore`: steer a low level by hand, live in the browser."""

from __future__ import annotations

import os
import sys
from contextlib import suppress
from pathlib import Path
from typing import Annotated

import typer

from lacoloco_cli.console import note
from lacoloco_cli.options import IN_A_RUN
from lacoloco_cli.play import named_source
from lacoloco_cli.session import Session, path_text, verb

app = typer.Typer()

STEERABLE = ("train-low", "train-high")
"""Stages whose newest artifact is explored when none is named; the first that has one."""


@verb(app, shared=IN_A_RUN)
def explore(
    session: Session,
    low: Annotated[
        Path | None,
        typer.Argument(
            metavar="[LOW]",
            help="A low level: an artifact, a run, or the name of a published one; default: the"
            " newest of the run used last. One with a high level has a target to drag, too.",
        ),
    ] = None,
    port: Annotated[
        int,
        typer.Option(
            "--port", min=0, max=65535, help="Of the page on this machine; 0: any that is free."
        ),
    ] = 0,
    seed: Annotated[int, typer.Option("--seed", min=0, help="Of latents and pushes.")] = 0,
) -> None:
    """Steer a robot by the latents of its low level, live in the browser, until Ctrl-C.

    Drag the sliders of the latent, push the robot, change the floor. The page is served on this
    machine only (127.0.0.1). Needs viser: pip install 'lacoloco[explore]'.
    """
    from lacoloco.pipelines.exploring.server import check_viser, local_server
    from lacoloco.pipelines.policies import load_policies
    from lacoloco.pipelines.robot import robot_of

    check_viser()
    policy = named_source(session, low, STEERABLE)
    artifact, policies = load_policies(policy, "low")
    spec = robot_of(artifact, session.progress.say)

    from threading import Event

    from lacoloco.pipelines.exploring.live import run
    from lacoloco.pipelines.exploring.page import Page
    from lacoloco.pipelines.exploring.world import ExploredWorld

    world = ExploredWorld(artifact, policies, spec, seed=seed)
    name = path_text(policy) if low is None else str(low)
    with local_server(port) as server:
        page = Page(server, world, f"{name} ({spec.name})")
        address = f"http://{server.get_host()}:{server.get_port()}/"
        note(f"{address}  (Ctrl-C ends)")
        open_browser(address)
        with suppress(KeyboardInterrupt):
            run(world, page, Event())
    answer = {"policy": path_text(policy), "robot": spec.name, "address": address}
    session.answer(answer, lambda: None)


def open_browser(address: str) -> None:
    """Show the page where there is a screen, and a person who started this in a terminal."""
    import webbrowser

    screen = sys.platform in ("darwin", "win32") or any(
        os.environ.get(name) for name in ("DISPLAY", "WAYLAND_DISPLAY")
    )
    if screen and sys.stdout.isatty():
        webbrowser.open(address)
