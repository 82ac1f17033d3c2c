"""The way back from an artifact to the files it was made of, down to the mocap file."""

from __future__ import annotations

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

    Every file's hash is compared with the one recorded when it was used.

    Raises:
        ArtifactError: the artifact at `path` itself cannot be read.
    """
    path = Path(path)
    header = read_header(path)
    return [Ancestor(0, path, "ok", "", header), *_ancestors(header, 1, {path.resolve()})]


def _ancestors(header: Header, depth: int, above: set[Path]) -> Iterator[Ancestor]:
    for parent in header.parents:
        path = _locate(parent, header)
        state, own = _inspect(path, parent.sha256)
        yield Ancestor(depth, path, state, parent.sha256, own)
        # A changed file may name one of its descendants; an unchanged one cannot.
        if own is not None and path.resolve() not in above:
            yield from _ancestors(own, depth + 1, above | {path.resolve()})


def _locate(parent: Parent, header: Header) -> Path:
    """Where a parent lies; what is published lost its ancestors, but some of them are published
    too.
    """
    path = parent.locate(header.path)
    return path if path.is_file() else published.find_copy(parent.sha256) or path


def _inspect(path: Path, expected: str) -> tuple[str, Header | None]:
    if not path.is_file():
        return "missing", None
    state = "ok" if hash_file(path) == expected else "changed"
    if path.suffix != ".h5":
        return state, None
    try:
        return state, read_header(path)
    except ArtifactError:
        return "damaged", None
