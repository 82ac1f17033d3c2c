"""`lacoloco generate`: motions performed by expert policies."""

from __future__ import annotations

from typing import Annotated

import typer

from lacoloco_cli.options import DEFAULT_ROBOT, Robot
from lacoloco_cli.session import Session, path_text, verb

app = typer.Typer()


@verb(app)
def generate(
    session: Session,
    robot: Robot = DEFAULT_ROBOT,
    retrain: Annotated[
        bool, typer.Option("--retrain", help="Train the experts again, even if there are some.")
    ] = False,
) -> None:
    """Record motions of expert policies; train the experts first if there are none."""
    from lacoloco.pipelines import generate as stage

    config = session.config(stage.PRESETS)
    result = stage.run(config, session.context(), robot=robot, retrain=retrain)
    session.answer({"artifact": path_text(result.artifact), **result.metrics})
