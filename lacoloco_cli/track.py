"""`lacoloco track`: motions as a robot performs them, from a policy that follows retargeted
ones.
"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from lacoloco_cli.session import Session, path_text, verb

app = typer.Typer()


@verb(app)
def track(
    session: Session,
    motions: Annotated[
        list[Path] | None,
        typer.Option(
            "--motions",
            help=(
                "Motions, or their published name; may be repeated; default: the run's newest "
                "retargeted ones."
            ),
        ),
    ] = None,
) -> None:
    """Train a policy that follows motions in simulation, and record what it does."""
    from lacoloco.datasets.published import resolve
    from lacoloco.pipelines import track as stage

    config = session.config(stage.PRESETS)
    given = motions or session.begun_inputs()
    sources = [
        resolve(one) for one in given or [session.store.newest(session.run_name, "retarget")]
    ]
    result = stage.run(config, session.context(), motions=sources)
    session.answer({"artifact": path_text(result.artifact), **result.metrics})
