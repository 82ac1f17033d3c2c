"""`lacoloco runs publish`: put an artifact among those that come with lacoloco."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from lacoloco_cli.console import note
from lacoloco_cli.options import READING
from lacoloco_cli.policy_choice import best
from lacoloco_cli.session import Session, path_text, verb

app = typer.Typer()


@verb(app, "publish", shared=READING)
def publish_artifact(
    session: Session,
    source: Annotated[
        str, typer.Argument(metavar="RUN|PATH", help="An artifact, or a run: its best policy.")
    ],
    name: Annotated[str, typer.Argument(metavar="NAME", help="E.g. solo12-synthetic.")],
    uncommitted: Annotated[
        str,
        typer.Option(
            "--uncommitted",
            metavar="WHAT",
            help="What had been changed and not committed when it was made, and in which commit it "
            "is now; goes into the record.",
        ),
    ] = "",
) -> None:
    """Copy an artifact into datasets/published, with its lineage, to be used by its name."""
    from lacoloco.datasets.publishing import MOST_BYTES, publish, total_bytes

    artifact = Path(source)
    if not artifact.is_file():
        session.run = source
        artifact = best(session)
    published = publish(artifact, name, uncommitted=uncommitted)
    payload: dict[str, Any] = {
        "published": path_text(published),
        "name": name,
        "source": path_text(artifact),
        "bytes": published.stat().st_size,
        "total_bytes": total_bytes(),
    }

    def show() -> None:
        used, most = payload["total_bytes"] / 1e6, MOST_BYTES / 1e6
        typer.echo(f"{payload['published']}  ({used:.1f} of {most:.0f} MB in use)")

    session.answer(payload, show)
    note("add its row to datasets/published/README.md, then commit the .h5 and the .json")
