"""`lacoloco train-high`: a low-level policy and a task to a high-level policy."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from lacoloco_cli.options import Checkpoint, Observe, Seeds
from lacoloco_cli.seeds import observing, taken_over, train_seeds
from lacoloco_cli.session import Session, verb

if TYPE_CHECKING:
    from lacoloco.pipelines.stage import StageContext

app = typer.Typer()


@verb(app, torchrun=True)
def train_high(
    session: Session,
    low: Annotated[
        Path | None,
        typer.Option(
            "--low",
            help="Low-level policy, or its published name (a high level's artifact holds one too);"
            " default: the run's newest of the same seed, or newest.",
        ),
    ] = None,
    task: Annotated[
        Path | None,
        typer.Option(
            "--task",
            help="File of the task to train on (robots/README.md); default: the robot's reach.",
        ),
    ] = None,
    observe: Observe = None,
    checkpoint: Checkpoint = None,
    seeds: Seeds = 1,
) -> None:
    """Train the high level: a policy that steers the low level by latents."""
    from lacoloco.datasets.published import resolve
    from lacoloco.pipelines import train_high as stage

    config = session.config(stage.PRESETS)
    low = resolve(low) if low else None
    config = observing(config, observe)
    if checkpoint is not None:
        config = taken_over(session, checkpoint, stage.TrainHighConfig())

    def chosen_low(context: StageContext) -> Path:
        begun = session.begun_inputs() if context.resume else []
        (chosen,) = session.takes(low or (begun or [newest_low(session, context.seed)])[0])
        return chosen

    train_seeds(
        session,
        seeds,
        lambda context: stage.run(config, context, low=chosen_low(context), task=task),
        stage.LOG_KEYS,
        checkpoint,
    )


def newest_low(session: Session, seed: int) -> Path:
    """The run's newest low level trained with this seed, else its newest.

    Raises:
        ArtifactError: The run has none.
    """
    from lacoloco.datasets.artifact import read_header

    found = session.store.all(session.run_name, "train-low")
    same = [path for path in found if read_header(path).seed == seed]
    return same[-1] if same else session.store.newest(session.run_name, "train-low")
