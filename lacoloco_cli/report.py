"""`lacoloco runs report`: tables of results in Markdown, made from evaluation artifacts."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from lacoloco_cli.failures import UserError
from lacoloco_cli.options import READING
from lacoloco_cli.session import Session, path_text, verb
from lacoloco_cli.written_files import TEXT, check_ending, check_output

if TYPE_CHECKING:
    from lacoloco.datasets.store import RunStore

app = typer.Typer()


@verb(app, "report", shared=READING)
def report(
    session: Session,
    targets: Annotated[
        list[str] | None,
        typer.Argument(
            metavar="[RUN|PATH]...",
            help="Runs (their newest evaluation) or evaluation artifacts; default: the run used "
            "last.",
        ),
    ] = None,
    out: Annotated[
        Path | None,
        typer.Option(
            "--out",
            metavar="FILE",
            help="Markdown file that the tables go into; what is written around them stays.",
        ),
    ] = None,
    name: Annotated[
        str | None,
        typer.Option("--name", help="Name of the table in the file; default: the run's."),
    ] = None,
) -> None:
    """Write tables of results with the origin of every figure: command, commit, machine, hashes."""
    from lacoloco.datasets.artifact import read_artifact
    from lacoloco_cli import report_table

    place = None
    if out is not None:
        check_ending("--out", out, ("md", "txt"))
        place = check_output("--out", out, TEXT, session.store.root)
    chosen = evaluations(session.store, targets or [session.run_name], name)
    reports = {one: report_table.section(one, read_artifact(path)) for one, path in chosen.items()}
    if place is not None:
        text = read_text(place)
        for one, markdown in reports.items():
            text = report_table.merge(text, one, markdown)
        write_text(place, text)
    payload: dict[str, Any] = {
        "out": path_text(out) if out else None,
        "reports": [
            {"name": one, "artifact": path_text(path), "markdown": reports[one]}
            for one, path in chosen.items()
        ],
    }

    def show() -> None:
        for one, markdown in reports.items():
            typer.echo(f"{one}: {path_text(out)}" if out else markdown)

    session.answer(payload, show)


def evaluations(store: RunStore, targets: Sequence[str], name: str | None) -> dict[str, Path]:
    """Name of the table -> evaluation, one per target.

    Args:
        store: Where runs are looked up.
        targets: Runs, artifacts, or directories of artifacts.
        name: Another name, for one target.

    Raises:
        UserError: Two tables would have one name, or a name is given to several.
        ArtifactError: A run has no evaluation.
    """
    if name is not None and len(targets) > 1:
        raise UserError(f"--name {name}: names one table; {len(targets)} are asked for")
    chosen: dict[str, Path] = {}
    for target in targets:
        path, own = _evaluation(store, target)
        key = name or own
        if key in chosen:
            raise UserError(f"{target}: a second table called {key}; report it with --name")
        chosen[key] = path
    return chosen


def _evaluation(store: RunStore, target: str) -> tuple[Path, str]:
    path = Path(target)
    if path.is_dir() and (path / "artifact.h5").is_file():
        path = path / "artifact.h5"
    if path.is_file():
        folders = path.resolve().parts  # run/stage/version/artifact.h5
        return path, folders[-4] if path.name == "artifact.h5" else path.stem
    return store.newest(target, "eval"), target


def read_text(file: Path) -> str:
    """What is in the file so far; nothing where there is none.

    Raises:
        ArtifactError: It cannot be read.
    """
    from lacoloco.datasets.errors import storage_errors

    if not file.exists():
        return ""
    with storage_errors(file, "read"):
        return file.read_text(encoding="utf-8")


def write_text(file: Path, text: str) -> None:
    """Exchange the file at once, so that an interruption leaves the old one.

    Raises:
        ArtifactError: It cannot be written.
    """
    from lacoloco.datasets.atomic_write import write_file

    write_file(file, text.encode(), replace=True)
