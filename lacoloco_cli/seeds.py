"""What `train-low` and `train-high` share: several seeds in one call, and how they are shown."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar, cast

import typer

from lacoloco_cli import console
from lacoloco_cli.failures import UserError
from lacoloco_cli.overrides import restored
from lacoloco_cli.session import Config, Session, check_device, path_text

if TYPE_CHECKING:
    from lacoloco.pipelines.high_level.config import TrainHighConfig
    from lacoloco.pipelines.low_level.config import TrainLowConfig
    from lacoloco.pipelines.sim.observation import Measured
    from lacoloco.pipelines.stage import StageContext, StageResult

Trained = TypeVar("Trained", "TrainLowConfig", "TrainHighConfig")

SPEED = ("samples", "samples_per_second", "seconds")


def train_seeds(
    session: Session,
    count: int,
    train: Callable[[StageContext], StageResult],
    shown: Sequence[str],
    checkpoint: Path | None = None,
) -> None:
    """Train one seed after the other and show them together; under torchrun, all processes do.

    Args:
        session: The call.
        count: From `--seeds`.
        train: Trains the seed of its context.
        shown: Figures for the table; `--json` has them all.
        checkpoint: From `--checkpoint`.
    """
    from lacoloco.pipelines.learn import parallel

    trained = []
    check_device(session.device)
    with parallel.group(session.device):
        for context in contexts(session, count):
            result = train(replace(context, checkpoint=checkpoint))
            trained.append({"artifact": path_text(result.artifact), **result.metrics})
    answer = dict(trained[-1])
    if count > 1:
        answer["seeds"] = trained
    session.answer(answer, lambda: show(trained, shown))


def taken_over(session: Session, checkpoint: Path, template: Config) -> Config:
    """The config of the training that a checkpoint is of; the call takes over its seed, too.

    Args:
        session: The call.
        checkpoint: From `--checkpoint`.
        template: A config of the stage.

    Raises:
        ArtifactError: It is missing or damaged.
        UserError: It is no checkpoint, or another stage's.
    """
    from lacoloco.datasets.artifact import read_header
    from lacoloco.datasets.errors import ArtifactError
    from lacoloco.pipelines.training.checkpoint import CHECKPOINT

    header = read_header(checkpoint)
    alien = f"{checkpoint}: is no checkpoint of {session.verb}; name one of its own"
    if header.schema != CHECKPOINT or not header.config:
        raise UserError(alien)
    session.seed = header.seed or 0
    try:
        return restored(template, header.config)
    except ArtifactError as error:
        raise UserError(f"{alien} ({error})") from error


def observing(config: Trained, observe: str | None) -> Trained:
    """The config of a training whose policy observes what `--observe` says; as it was without.

    Raises:
        UserError: Neither full nor onboard.
    """
    if observe is None:
        return config
    if observe not in ("full", "onboard"):
        raise UserError(f"--observe {observe}: use full or onboard")
    measured = cast("Measured", observe)
    observation = replace(config.observation, measured=measured)
    return replace(config, observation=observation)


def contexts(session: Session, count: int) -> Iterator[StageContext]:
    """A context per seed, counted up from `--seed`.

    With `--resume`, the seeds before the unfinished one are done and left out, that one is
    continued, and those after it begin anew.
    """
    seeds = range(session.seed, session.seed + count)
    context = session.context()
    if not session.resume:
        yield from (replace(context, seed=seed) for seed in seeds)
        return
    unfinished = session.begun.seed if session.begun is not None else None
    first = unfinished if unfinished is not None and unfinished in seeds else session.seed
    yield replace(context, seed=first)
    yield from (
        replace(context, seed=seed, resume=False, version="") for seed in seeds if seed > first
    )


def show(trained: Sequence[dict[str, Any]], shown: Sequence[str]) -> None:
    """Print one column per seed, a row per metric, and where the artifacts are."""
    names = [name for name in ("method", *SPEED, *shown) if name in trained[0]]
    rows = [[name, *(one.get(name) for one in trained)] for name in names]
    console.print_table(["", *(f"seed {one['seed']}" for one in trained)], rows)
    for one in trained:
        typer.echo(f"artifact: {one['artifact']}")
        for warning in one.get("warnings", ()):
            console.note(f"WARNING, seed {one['seed']}: {warning}")
