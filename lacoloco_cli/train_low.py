"""`lacoloco train-low`: motions to a low-level policy."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, cast

import typer

from lacoloco_cli.failures import UserError
from lacoloco_cli.options import Checkpoint, Observe, Seeds
from lacoloco_cli.seeds import observing, taken_over, train_seeds
from lacoloco_cli.session import Session, path_text, verb

if TYPE_CHECKING:
    from lacoloco.pipelines.learn.ase import Discriminator

app = typer.Typer()

DISCRIMINATORS = ("gan", "drail")


@verb(app, torchrun=True)
def train_low(
    session: Session,
    disc: Annotated[
        str | None,
        typer.Option("--disc", metavar="gan|drail", help="Discriminator; default: drail."),
    ] = None,
    cat: Annotated[
        bool | None,
        typer.Option("--cat/--no-cat", help="Constraints as terminations; default: on."),
    ] = None,
    motions: Annotated[
        list[Path] | None,
        typer.Option(
            "--motions",
            help="Motions, or their published name; may be repeated; default: the run's newest"
            " generated ones, or its newest retargeted or imported ones as `track` performed them.",
        ),
    ] = None,
    observe: Observe = None,
    checkpoint: Checkpoint = None,
    seeds: Seeds = 1,
) -> None:
    """Train the low level: a policy that turns latents into motion like the clips' (ASE)."""
    from lacoloco.datasets.published import resolve
    from lacoloco.pipelines import train_low as stage

    config = session.config(stage.PRESETS)
    if disc is not None:
        if disc not in DISCRIMINATORS:
            raise UserError(f"--disc {disc}: use {' or '.join(DISCRIMINATORS)}")
        chosen = cast("Discriminator", disc)
        config = replace(config, ase=replace(config.ase, discriminator=chosen))
    if cat is not None:
        config = replace(config, cat=cat)
    config = observing(config, observe)
    if checkpoint is not None:
        config = taken_over(session, checkpoint, stage.TrainLowConfig())
    motions = motions or session.begun_inputs() or newest_motions(session)
    motions = session.takes(*(resolve(one) for one in motions))
    train_seeds(
        session,
        seeds,
        lambda context: stage.run(config, context, motions=motions),
        stage.LOG_KEYS,
        checkpoint,
    )


def newest_motions(session: Session) -> list[Path]:
    """The run's newest motions: generated ones, or retargeted or imported ones, as they were
    performed if they were.

    Raises:
        UserError: The run has several kinds, and only the user knows which are meant.
        ArtifactError: None made any; the message names a verb that does.
    """
    from lacoloco.datasets.artifact import read_header

    store, run = session.store, session.run_name
    generated, performed, retargeted, imported = (
        store.all(run, verb)[-1:] for verb in ("generate", "track", "retarget", "import")
    )
    followed = [
        parent.locate(path).absolute() for path in performed for parent in read_header(path).parents
    ]
    if performed and retargeted and retargeted[0].absolute() not in followed:
        session.progress.say(
            "`lacoloco track` has not followed the newest retargeted motions: taking those it did"
        )
    kinds = [kind for kind in (generated, performed or retargeted) if kind]
    if imported and imported[0].absolute() not in followed:
        kinds.append(imported)
    found = [path for kind in kinds for path in kind]
    if len(kinds) > 1:
        verbs = " and of ".join(path.parents[1].name for path in found)
        named = " ".join(f"--motions {path_text(path)}" for path in found)
        raise UserError(
            f"run '{run}' has motions of {verbs}; name those to train on, or all: {named}"
        )
    return found or [store.newest(run, "generate")]
