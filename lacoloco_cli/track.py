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
                "retargeted and imported ones."
            ),
        ),
    ] = None,
) -> None:
    """Train a policy that follows motions in simulation, and record what it does."""
    from lacoloco.datasets.published import resolve
    from lacoloco.pipelines import track as stage

    config = session.config(stage.PRESETS)
    given = motions or session.begun_inputs()
    sources = [resolve(one) for one in given or _newest(session)]
    session.takes(*sources)
    result = stage.run(config, session.context(), motions=sources)
    session.answer({"artifact": path_text(result.artifact), **result.metrics})


def _newest(session: Session) -> list[Path]:
    """The run's newest retargeted and imported motions.

    Raises:
        ArtifactError: It has none.
    """
    store, run = session.store, session.run_name
    found = [path for verb in ("retarget", "import") for path in store.all(run, verb)[-1:]]
    return found or [store.newest(run, "retarget")]
