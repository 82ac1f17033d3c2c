"""The way back from an artifact to the files it was made of, down to the mocap file."""

from __future__ import annotations

import os
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from lacoloco.datasets import published
from lacoloco.datasets.artifact import Header, read_header
from lacoloco.datasets.errors import ArtifactError
from lacoloco.datasets.hashing import hash_file
from lacoloco.datasets.provenance import Parent


@dataclass(frozen=True)
class Ancestor:
    """One file in the lineage of an artifact.

    Attributes:
        depth: 0 for the artifact itself, 1 for its parents, and so on.
        path: where the file lies, or should.
        state: "ok"; "missing"; "changed" since it was used; "damaged" (no longer readable).
        sha256: hash of the file when it was used; "" for the artifact itself.
        header: what it says about itself; None for source files and unreadable ones.
    """

    depth: int
    path: Path
    state: str
    sha256: str
    header: Header | None


def lineage(path: Path) -> list[Ancestor]:
    """All files an artifact was made of, itself first, each followed by its own parents.

    A file that several were made of is followed by its parents the first time only. Every file's
    hash is compared with the one recorded when it was used; each file is read once.

    Raises:
        ArtifactError: the artifact at `path` itself cannot be read.
    """
    path = Path(path)
    header = read_header(path)
    return [Ancestor(0, path, "ok", "", header), *_ancestors(header, _real(path))]


def _ancestors(header: Header, place: str) -> Iterator[Ancestor]:
    """Depth first, without recursion: a chain of parents may be longer than Python's stack."""
    known: dict[str, tuple[str, Header | None]] = {}
    followed = {place}
    pending = [(1, parent, header) for parent in reversed(header.parents)]
    while pending:
        depth, parent, child = pending.pop()
        path = _locate(parent, child)
        place = _real(path)
        if place not in known:
            known[place] = _inspect(path)
        digest, own = known[place]
        damaged = path.suffix == ".h5" and own is None and digest
        state = "damaged" if damaged else _state(digest, parent.sha256)
        yield Ancestor(depth, path, state, parent.sha256, own)
        if own is not None and place not in followed:
            followed.add(place)
            pending += [(depth + 1, one, own) for one in reversed(own.parents)]


def _real(path: Path) -> str:
    return os.path.realpath(path)  # Path.resolve would fail where links go round in a circle


def _locate(parent: Parent, header: Header) -> Path:
    """Where a parent lies; what is published lost its ancestors, but some of them are published
    too.
    """
    path = parent.locate(header.path)
    return path if path.is_file() else published.find_copy(parent.sha256) or path


def _inspect(path: Path) -> tuple[str, Header | None]:
    """Hash of a file, "" where there is none to read, and what it says about itself, if it does."""
    try:
        digest = hash_file(path)
    except ArtifactError:
        return "", None
    try:
        return digest, read_header(path) if path.suffix == ".h5" else None
    except ArtifactError:
        return digest, None


def _state(digest: str, expected: str) -> str:
    if not digest:
        return "missing"
    return "ok" if digest == expected else "changed"
