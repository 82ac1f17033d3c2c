"""`lacoloco explore`: steer a low level by hand, live in the browser."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from lacoloco_cli.options import IN_A_RUN, MotionsToCompare, Port
from lacoloco_cli.play import named_source, open_browser
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
    port: Port = 0,
    latents: Annotated[
        int,
        typer.Option(
            "--latents", min=0, max=4096, help="How many are held for the map; 0: no map."
        ),
    ] = 256,
    motions: MotionsToCompare = None,
    seed: Annotated[
        int, typer.Option("--seed", min=0, max=2**31 - 1, help="Of latents and pushes.")
    ] = 0,
) -> None:
    """Steer a robot by the latents of its low level, live in the browser, until Ctrl-C.

    Drag the sliders of the latent, click or drag on the map of what latents do, push the robot,
    change the floor; with a high level, drag its target. The nearest clip is named where the
    policy's clips are at hand. The page is served on this machine only (127.0.0.1). Needs viser:
    pip install 'lacoloco[explore]'.
    """
    from lacoloco.datasets.published import resolve
    from lacoloco.pipelines.exploring import explorer

    policy = named_source(session, low, STEERABLE)
    title = path_text(policy) if low is None else str(low)
    chosen = [resolve(one) for one in motions or ()]
    config = explorer.ExploreConfig(policy, title, chosen, latents, seed, port)
    answer = explorer.explore(config, session.progress, open_browser)
    session.answer({"policy": path_text(policy), **answer}, lambda: None)
