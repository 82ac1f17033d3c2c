"""`lacoloco runs`: list what lies in runs/, show where it comes from, verify that it is intact.

Its further sub-commands have files of their own.
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from lacoloco_cli import clean, console, coverage, plot, publish, report, run_page
from lacoloco_cli.failures import USER_MISTAKE, UserError
from lacoloco_cli.options import READING
from lacoloco_cli.session import Session, path_text, verb

if TYPE_CHECKING:
    from lacoloco.datasets.artifact import Header
    from lacoloco.datasets.lineage import Ancestor
    from lacoloco.datasets.store import RunStore

app = typer.Typer(
    no_args_is_help=True,
    help="List, show, plot, report, page, verify, clean and publish what lies in runs/.",
)
app.add_typer(clean.app)
app.add_typer(plot.app)
app.add_typer(coverage.app)
app.add_typer(publish.app)
app.add_typer(report.app)
app.add_typer(run_page.app)

_WHAT = "A run, an artifact, its directory, or a published name; default: "
Shown = Annotated[
    str | None, typer.Argument(metavar="[RUN|PATH]", help=_WHAT + "the run used last.")
]
Verified = Annotated[str | None, typer.Argument(metavar="[RUN|PATH]", help=_WHAT + "all runs.")]


@verb(app, "list", shared=READING)
def list_runs(session: Session) -> None:
    """List all artifacts of all runs, and the unfinished ones."""
    store = session.store
    rows = [row for run in store.runs() for row in _rows(store, run)]

    def show() -> None:
        if not rows:
            typer.echo(f"no runs in {store.root} yet; `lacoloco run quickstart` makes one")
            return
        columns = ["run", "stage", "version", "state", "robot", "seed", "size MB", "created"]
        table = [
            [row[name] for name in ("run", "stage", "version", "state", "robot", "seed")]
            + [round(row["bytes"] / 1e6, 2), row["created"]]
            for row in rows
        ]
        console.print_table(columns, table)

    answer = {"root": str(store.root), "last_run": store.last_run(), "artifacts": rows}
    session.answer(answer, show)


@verb(app, "show", shared=READING)
def show_run(session: Session, target: Shown = None) -> None:
    """Show artifacts and their lineage, back to the files that all began with."""
    from lacoloco.datasets.artifact import read_artifact
    from lacoloco.datasets.errors import ArtifactError
    from lacoloco.datasets.lineage import lineage

    found, broken = [], []
    for path in _ends_of_chains(_artifacts(session.store, target or session.run_name)):
        try:  # one bad file must not hide the others
            artifact = read_artifact(path)
            found.append((artifact, artifact.data_hash, lineage(path)))
        except ArtifactError as error:
            broken.append(str(error))

    def show() -> None:
        for header, data_hash, ancestors in found:
            _show_artifact(header, data_hash, ancestors)
        for problem in broken:
            console.note(f"error: {problem}")

    payload = [
        {**_describe(header), "data_hash": data_hash, "lineage": [_ancestor(a) for a in ancestors]}
        for header, data_hash, ancestors in found
    ]
    session.answer({"artifacts": payload, "problems": broken}, show)
    if broken:
        raise typer.Exit(USER_MISTAKE)


@verb(app, "verify", shared=READING)
def verify_runs(session: Session, target: Verified = None) -> None:
    """Read artifacts completely, compare every hash, and follow their lineage.

    The files beside an artifact are compared, too; those without a hash are named.
    """
    store = session.store
    runs = [target] if target else store.runs()
    paths = [path for run in runs for path in _artifacts(store, run, empty=target is None)]
    session.progress.start("verify", len(paths))
    results = []
    for count, path in enumerate(paths, 1):
        results.append(_verify(path))
        session.progress.advance(count)
    intact = all(result["intact"] for result in results)

    def show() -> None:
        rows = [
            ("ok" if r["intact"] else "BAD", path_text(Path(r["path"])), "; ".join(_remarks(r)))
            for r in results
        ]
        console.print_table(["", "artifact", ""], rows)

    session.answer({"intact": intact, "artifacts": results}, show)
    if not intact:
        raise typer.Exit(USER_MISTAKE)


def _rows(store: RunStore, run: str) -> list[dict[str, Any]]:
    from lacoloco.datasets.artifact import read_header
    from lacoloco.datasets.errors import ArtifactError

    rows = []
    for stage in store.stages(run):
        for path in store.all(run, stage):
            row: dict[str, Any] = {"run": run, "stage": stage, "version": path.parent.name}
            row |= {"state": "complete"}
            row |= {"path": str(path), "bytes": path.stat().st_size, "label": ""}
            try:
                header = read_header(path)
                row |= {"schema": header.schema, "robot": header.robot or None}
                row |= {"seed": header.seed, "created": header.created}
            except ArtifactError:
                row |= {"state": "damaged", "schema": None, "robot": None, "seed": None}
                row |= {"created": None}
            rows.append(row)
        for partial in store.partials(run, stage):
            size = sum(file.stat().st_size for file in partial.path.rglob("*") if file.is_file())
            row = {"run": run, "stage": stage, "version": partial.final.name}
            row |= {"state": "unfinished", "path": str(partial.path), "bytes": size}
            row |= {"label": partial.label, "schema": None, "robot": None, "seed": None}
            rows.append({**row, "created": None})
    return rows


def _artifacts(store: RunStore, target: str, *, empty: bool = False) -> list[Path]:
    """The artifact at a path, all complete ones of a run, or a published one."""
    from lacoloco.datasets import published

    path = Path(target)
    if path.is_dir() and (path / "artifact.h5").is_file():
        return [path / "artifact.h5"]
    if path.is_file() or path.suffix == ".h5":
        return [path]
    if target not in store.runs() and (named := published.find(target)) is not None:
        return [named]
    found = []
    if target in store.runs():
        found = [path for stage in store.stages(target) for path in store.all(target, stage)]
    if not found and not empty:
        known = ", ".join(store.runs()) or "none"
        raise UserError(f"'{target}': neither a file nor a run with artifacts; runs: {known}")
    return found


def _ends_of_chains(paths: list[Path]) -> list[Path]:
    """The newest artifact of each stage, without those that another one was made of."""
    from lacoloco.datasets.artifact import read_header
    from lacoloco.datasets.errors import ArtifactError

    newest = list({path.parent.parent: path for path in paths}.values())
    used = set()
    for path in newest:
        with suppress(ArtifactError):  # what cannot be read is nobody's descendant
            used |= {os.path.realpath(p.locate(path)) for p in read_header(path).parents}
    return [path for path in newest if os.path.realpath(path) not in used]


def _verify(path: Path) -> dict[str, Any]:
    from lacoloco.datasets.artifact import read_artifact
    from lacoloco.datasets.beside import ARTIFACT, Compared, compare
    from lacoloco.datasets.errors import ArtifactError
    from lacoloco.datasets.lineage import lineage

    try:
        artifact = read_artifact(path)
        beside = compare(path.parent, artifact.files) if path.name == ARTIFACT else Compared()
        lost = [a for a in lineage(path) if a.state != "ok"]
    except ArtifactError as error:
        reason = str(error).removeprefix(f"{path}: ")
        return {"path": str(path), "intact": False, "problems": [reason], "without_hash": []}
    # A source file may be gone, its hash is kept; one that differs is not what was used.
    intact = all(a.state == "missing" for a in lost) and not (beside.missing or beside.changed)
    problems = [_incomplete(path, beside.missing)] if beside.missing else []
    problems += [f"{name} beside it does not match its hash" for name in beside.changed]
    problems += [f"{path_text(a.path)} is {a.state}" for a in lost]
    answer = {"path": str(path), "intact": intact, "problems": problems}
    return answer | {"without_hash": list(beside.unknown)}


def _incomplete(path: Path, missing: Sequence[str]) -> str:
    return (
        f"not there beside it: {', '.join(missing)}; a version is copied as a whole folder"
        f" ({path.parent.name}/), never {path.name} alone"
    )


def _remarks(result: dict[str, Any]) -> list[str]:
    unknown = result["without_hash"]
    more = f" and {len(unknown) - 3} more" if len(unknown) > 3 else ""
    said = [f"no hash of {', '.join(unknown[:3])}{more}"] if unknown else []
    return [*result["problems"], *said]


def _describe(header: Header) -> dict[str, Any]:
    names = ["schema", "schema_version", "robot", "robot_hash", "seed", "created", "command"]
    names += ["lacoloco_version", "git_commit", "content_hash", "config"]
    return {"path": str(header.path)} | {name: getattr(header, name) for name in names}


def _ancestor(ancestor: Ancestor) -> dict[str, Any]:
    header = ancestor.header
    return {
        "depth": ancestor.depth,
        "path": str(ancestor.path),
        "state": ancestor.state,
        "sha256": ancestor.sha256,
        "schema": header.schema if header else None,
        "created": header.created if header else None,
        "command": header.command if header else None,
    }


def _show_artifact(header: Header, data_hash: str, ancestors: list[Ancestor]) -> None:
    from lacoloco_cli.json_output import to_json

    details = {**_describe(header), "data_hash": data_hash}
    details["config"] = to_json(details["config"])
    for key, value in details.items():
        if value not in ("", None):
            typer.echo(f"{key}: {value}")
    typer.echo("lineage:")
    for a in ancestors:
        what = f"{a.header.schema}, {a.header.created}" if a.header else f"sha256 {a.sha256[:16]}"
        mark = "" if a.state == "ok" else f"  {a.state.upper()}"
        typer.echo(f"{'  ' * (a.depth + 1)}{path_text(a.path)}  ({what}){mark}")
    typer.echo("")
