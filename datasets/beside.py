"""The files beside an artifact (pictures, logs, ONNX, pages): the artifact keeps their hashes."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from lacoloco.datasets.atomic_write import TEMPORARY, sync_directory
from lacoloco.datasets.errors import storage_errors
from lacoloco.datasets.hashing import hash_file

ARTIFACT = "artifact.h5"
PARTIAL = ".partial"
"""Ending of the directory of an unfinished version."""
LOCK = ".lock"
"""Held by the process that works on the version."""
BEGUN = ".begun.json"
"""What the version was begun with."""
CHECKPOINT = ".checkpoint.h5"
"""Ending of what a training goes on from."""
FINISHED_CLIPS = "finished_clips"
"""Directory of what a retargeting goes on from: each clip that it has finished, in a file."""
FINISHED_CLIPS_BEFORE = "pieces"
"""Name of this directory in earlier versions of lacoloco."""


def inputs_at(directory: Path) -> dict[Path, str]:
    """Absolute path -> SHA-256 of what an unfinished version was begun on; empty where that is not
    kept.
    """
    try:
        inputs = json.loads((directory / BEGUN).read_text(encoding="utf-8"))["inputs"]
        return {Path(one["path"]).absolute(): str(one["sha256"]) for one in inputs or ()}
    except (OSError, ValueError, KeyError, TypeError):
        return {}


@dataclass(frozen=True)
class Compared:
    """Names of the files that are not as the artifact says, relative to its directory.

    Attributes:
        missing: they are not there.
        changed: they have another hash.
        unknown: the artifact has no hash of them.
    """

    missing: tuple[str, ...] = ()
    changed: tuple[str, ...] = ()
    unknown: tuple[str, ...] = ()


def is_working(name: str) -> bool:
    """Whether a file or directory serves the unfinished version only, and goes with it."""
    directories = (FINISHED_CLIPS, FINISHED_CLIPS_BEFORE)
    return (
        name in (LOCK, BEGUN, *directories)
        or name.startswith(TEMPORARY)
        or name.endswith(CHECKPOINT)
    )


def working_files(directory: Path) -> list[Path]:
    """What serves the unfinished version only and lies in its directory."""
    return sorted(path for path in directory.iterdir() if is_working(path.name))


def files_beside(directory: Path) -> list[str]:
    """All files beside the artifact, by name relative to its directory, sorted.

    Hidden ones at the top are left out: file managers and network file systems put theirs there.
    """
    found = []
    for folder, folders, names in os.walk(directory):
        at_top = Path(folder) == directory
        if at_top:
            folders[:] = [name for name in folders if _is_kept(name)]
        for name in names:
            if not at_top or (name != ARTIFACT and _is_kept(name)):
                found.append((Path(folder) / name).relative_to(directory).as_posix())
    return sorted(found)


def _is_kept(name: str) -> bool:
    return not name.startswith(".") and not is_working(name)


def seal(directory: Path) -> dict[str, str]:
    """Force the files beside an artifact that is about to be written to disk.

    Returns:
        SHA-256 of each by its name relative to the directory.

    Raises:
        ArtifactError: the file system refuses.
    """
    hashes = {}
    with storage_errors(directory, "write"):
        for name in files_beside(directory):
            descriptor = os.open(directory / name, os.O_RDONLY)
            try:
                os.fsync(descriptor)
            finally:
                os.close(descriptor)
            hashes[name] = hash_file(directory / name)
        for folder in {(directory / name).parent for name in hashes}:
            sync_directory(folder)
    return hashes


def compare(directory: Path, hashes: Mapping[str, str] | None) -> Compared:
    """Compare the files beside an artifact with the hashes in it.

    Only what lies in the directory is read, whatever names the hashes have.

    Args:
        directory: that of the artifact.
        hashes: as `seal` gave them; None for an artifact of before, which has none.

    Raises:
        ArtifactError: a file cannot be read.
    """
    there = files_beside(directory)
    known = hashes or {}
    return Compared(
        missing=tuple(sorted(set(known) - set(there))),
        changed=tuple(
            name for name in there if name in known and _differs(directory / name, known[name])
        ),
        unknown=tuple(name for name in there if name not in known),
    )


def _differs(path: Path, expected: str) -> bool:
    # A link or a pipe in the file's place is not what was written.
    return path.is_symlink() or not path.is_file() or hash_file(path) != expected
