"""`lacoloco runs clean`: what killed stages left and nobody works on."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from lacoloco_cli import console
from lacoloco_cli.failures import UserError
from lacoloco_cli.options import READING
from lacoloco_cli.session import Session, path_text, verb

if TYPE_CHECKING:
    from lacoloco.datasets.store import RunStore

app = typer.Typer()

Cleaned = Annotated[
    str | None, typer.Argument(metavar="[RUN]", help="Only this run; default: all runs.")
]
Yes = Annotated[
    bool, typer.Option("--yes", "--force", help="Remove it; otherwise it is only shown.")
]


@verb(app, "clean", shared=READING)
def clean(session: Session, run: Cleaned = None, yes: Yes = False) -> None:
    """Show, and with --yes remove, unfinished versions that no process works on.

    Complete versions stay. What is removed cannot be continued with --resume any more.
    """
    store = session.store
    if run is not None and run not in store.runs():
        raise UserError(f"'{run}': no such run; runs: {', '.join(store.runs()) or 'none'}")
    found = [row for name in ([run] if run else store.runs()) for row in _left(store, name)]
    rows = list({row["path"]: row for row in found}.values())  # some belong to all runs
    if yes:
        rows = [row for row in rows if store.clean(Path(row["path"]))]

    def show() -> None:
        if not rows:
            typer.echo(f"nothing to remove in {store.root}")
            return
        table = [[path_text(Path(row["path"])), round(row["bytes"] / 1e6, 2)] for row in rows]
        console.print_table(["removed" if yes else "would be removed", "size MB"], table)
        if not yes:
            typer.echo("remove it with --yes, or continue an unfinished version with --resume")

    session.answer({"root": str(store.root), "removed": yes, "left": rows}, show)


def _left(store: RunStore, run: str) -> Iterator[dict[str, Any]]:
    for path in store.leftovers(run):
        files = [path] if path.is_file() else [one for one in path.rglob("*") if one.is_file()]
        yield {"path": str(path), "bytes": sum(one.stat().st_size for one in files)}
