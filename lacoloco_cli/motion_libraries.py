"""Which library of motions is meant: by a run, a path or a published name."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from lacoloco_cli.failures import UserError
from lacoloco_cli.session import Session, path_text

if TYPE_CHECKING:
    from lacoloco.datasets.store import RunStore

SCHEMA = "lacoloco/motions"


def chosen_library(session: Session, target: str | None) -> Path:
    """The one library of motions that is meant: of several of a run the newest.

    Raises:
        UserError: There is none.
    """
    target = target or session.run_name
    found = libraries(session.store, target)
    newest = max(found, key=lambda path: path.stat().st_mtime)
    if len(found) > 1:
        session.progress.say(f"taking {path_text(newest)}, the newest of {len(found)} in {target}")
    return newest


def libraries(store: RunStore, target: str) -> list[Path]:
    """The motions that a run, a path or a published name stands for.

    Raises:
        UserError: None.
    """
    from lacoloco.datasets import published

    path = Path(target)
    if path.is_dir() and (path / "artifact.h5").is_file():
        return [path / "artifact.h5"]
    if path.is_file() or path.suffix == ".h5":
        return [path]
    if target not in store.runs() and (named := published.find(target)) is not None:
        return [named]
    found = libraries_of_run(store, target) if target in store.runs() else []
    if not found:
        known = ", ".join(store.runs()) or "none"
        raise UserError(
            f"'{target}': neither a file nor a run with motions; runs: {known}; generate, retarget"
            " and motions import make some"
        )
    return found


def libraries_of_run(store: RunStore, run: str) -> list[Path]:
    """All motions of a run, in the order of its stages."""
    from lacoloco.datasets.artifact import read_header
    from lacoloco.datasets.errors import ArtifactError

    def holds_motions(path: Path) -> bool:
        try:
            return read_header(path).schema == SCHEMA
        except ArtifactError:
            return False

    every = [path for stage in store.stages(run) for path in store.all(run, stage)]
    return [path for path in every if holds_motions(path)]
