"""`lacoloco switching`: how a high-level policy switches skills."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

import typer

from lacoloco_cli.options import AT_ONCE, MotionsToCompare
from lacoloco_cli.policy_choice import best
from lacoloco_cli.session import Session, path_text, verb
from lacoloco_cli.written_files import check_ending, check_output, copy_to

app = typer.Typer()


@verb(app, shared=AT_ONCE)
def switching(
    session: Session,
    policy: Annotated[
        Path | None,
        typer.Option(
            "--policy", help="High-level policy, or its published name; default: the run's best."
        ),
    ] = None,
    motions: MotionsToCompare = None,
    out: Annotated[
        Path | None,
        typer.Option("--out", metavar="FILE", help="Also write the picture there (.png)."),
    ] = None,
) -> None:
    """Count the episodes that walk first and reach last, and draw one of them."""
    measure(session, policy, motions or [], out, option="--out")


def measure(
    session: Session,
    policy: Path | None,
    motions: Sequence[Path],
    out: Path | None,
    *,
    option: str,
) -> None:
    """Run the stage and answer with what it found.

    Args:
        session: The call.
        policy: What is played; None for the run's best.
        motions: What it is compared with; empty for those that the policy comes from.
        out: Where the picture goes besides the run's directory.
        option: The option that named `out`.
    """
    from lacoloco.datasets.published import resolve
    from lacoloco.pipelines import switching as stage

    config = session.config(stage.PRESETS)
    place = None
    if out is not None:
        place = check_output(option, out, check_ending(option, out, ("png",)), session.store.root)
    (policy,) = session.takes(resolve(policy) if policy else best(session))
    result = stage.run(
        config, session.context(), policy=policy, motions=[resolve(one) for one in motions]
    )
    picture = Path(result.metrics["picture"])
    if place is not None:
        copy_to(option, picture, place)
    answer = {"artifact": path_text(result.artifact), **result.metrics}
    answer["picture"] = str(out or path_text(picture))

    def show() -> None:
        share, count = answer["walk_first_reach_last"], answer["episodes"]
        typer.echo(f"{share:.1%} of {count} episodes walk first and reach last")
        typer.echo(answer["picture"])

    session.answer(answer, show)
