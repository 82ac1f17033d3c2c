"""Putting an artifact among those that come with lacoloco: an exact copy, and beside it where it
comes from.

The copy keeps its bytes, so everything made of the original finds it by its hash. Its ancestors
mostly stay behind in somebody's runs; what they were is written into `NAME.json`.
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from lacoloco.datasets import provenance, published, samples
from lacoloco.datasets.artifact import Header, read_artifact
from lacoloco.datasets.atomic_write import write_file
from lacoloco.datasets.errors import ArtifactError, DatasetError
from lacoloco.datasets.hashing import hash_file
from lacoloco.datasets.lineage import Ancestor, lineage

MOST_BYTES = 15_000_000
"""All published artifacts together: they travel with every installation."""

_NAME = re.compile(r"[a-z0-9]+(-[a-z0-9]+)*")
_RECORDED = (
    "schema",
    "robot",
    "seed",
    "created",
    "command",
    "lacoloco_version",
    "git_commit",
    "content_hash",
)


def publish(artifact: Path, name: str, *, uncommitted: str = "") -> Path:
    """Copy an artifact into `datasets/published` under a name that is still free, with its lineage
    beside it.

    Args:
        artifact: what to publish.
        name: lower-case words joined by hyphens, e.g. `solo12-synthetic`.
        uncommitted: what had been changed in the checkout, and in which commit it is now; it goes
            into the record. "": artifacts of changed checkouts are refused.

    Returns:
        Path of the copy.

    Raises:
        ArtifactError: the artifact is damaged or the file system refuses.
        DatasetError: a name that is taken or cannot be one; lacoloco runs outside a checkout; the
            lineage has gaps, uncommitted code, or sources that are not lacoloco's own;
            `uncommitted` is said of committed code; or all together would be too large.
    """
    if not _NAME.fullmatch(name):
        raise DatasetError(f"'{name}': use lower-case letters and digits, joined by hyphens")
    if published.find(name) is not None:
        raise DatasetError(
            f"'{name}' is published already and is never replaced; choose another name"
        )
    if not provenance.git_commit():
        raise DatasetError("publishing is for a git checkout of lacoloco, which this is not")
    read_artifact(artifact)
    described = list(_entries(lineage(artifact)))
    ancestors = [ancestor for ancestor, _ in described]
    for ancestor in ancestors:
        _check(ancestor, uncommitted)
    if uncommitted and not any(a.header is not None and _changed(a.header) for a in ancestors):
        raise DatasetError("--uncommitted: all of it was made by committed code; leave it out")
    _check_size(artifact)
    record = {
        "name": name,
        "sha256": hash_file(artifact),
        "lineage": [entry for _, entries in described for entry in entries],
    }
    if uncommitted:
        record["uncommitted"] = uncommitted
    write_file(
        published.FOLDER / f"{name}.json",
        json.dumps(record, indent=1).encode() + b"\n",
        replace=True,
    )
    return write_file(published.FOLDER / f"{name}.h5", artifact.read_bytes())


def total_bytes() -> int:
    """Size of everything published, lineage included."""
    return sum(
        file.stat().st_size
        for file in published.FOLDER.iterdir()
        if file.suffix in (".h5", ".json")
    )


def _entries(ancestors: list[Ancestor]) -> Iterator[tuple[Ancestor, list[dict[str, Any]]]]:
    """Each ancestor with its entries in the record. A published one brings the recorded entries of
    its own ancestors, whose files may be on another machine; so those do not follow.
    """
    below: int | None = None  # depth of the published one whose ancestors follow
    for ancestor in ancestors:
        if below is not None and ancestor.depth > below:
            continue
        path, below, record = ancestor.path, None, None
        if path.resolve().parent == published.FOLDER.resolve() and ancestor.state == "ok":
            record = recorded(path.stem)
        if record is None:
            yield ancestor, [_describe(ancestor)]
            continue
        below = ancestor.depth
        yield ancestor, [e | {"depth": e["depth"] + below} for e in record["lineage"]]


def _check(ancestor: Ancestor, uncommitted: str) -> None:
    path, header = ancestor.path, ancestor.header
    if ancestor.state != "ok":
        raise DatasetError(
            f"{path}: is {ancestor.state}, so the lineage cannot be recorded; make the artifact "
            "again"
        )
    if header is None:
        own = path.resolve().is_relative_to(Path(samples.__file__).resolve().parent)
        if not own:
            raise DatasetError(
                f"{path}: only what derives from lacoloco's own samples may be published"
            )
        return
    if path.resolve().parent == published.FOLDER.resolve():
        return  # has passed before
    if not header.git_commit:
        raise DatasetError(
            f"{path}: made by code that was not committed (no checkout); make it again in one"
        )
    if _changed(header) and not uncommitted:
        raise DatasetError(
            f"{path}: made by code that was not committed ({header.git_commit}); commit and make "
            "it again, or say what had been changed: --uncommitted"
        )
    if any(Path(word.partition("=")[2] or word).is_absolute() for word in header.command.split()):
        raise DatasetError(
            f"{path}: its command names a place on this machine ({header.command}); make it again "
            "with names or relative paths"
        )
    if ancestor.depth == 0 and any(Path(parent.path).is_absolute() for parent in header.parents):
        raise DatasetError(
            f"{path}: names a parent by its place on this machine; make both in one runs directory"
        )


def _changed(header: Header) -> bool:
    """Whether an artifact was made by a checkout with changes that were not committed."""
    return header.git_commit.endswith("-dirty")


def _check_size(artifact: Path) -> None:
    total = total_bytes() + artifact.stat().st_size
    if total > MOST_BYTES:
        raise DatasetError(
            f"{artifact}: all published artifacts would have {total / 1e6:.1f} MB, "
            f"{MOST_BYTES / 1e6:.0f} MB is the most"
        )


def _describe(ancestor: Ancestor) -> dict[str, Any]:
    """What is known of one ancestor, without its place on this machine."""
    sha256 = ancestor.sha256 or hash_file(ancestor.path)
    row: dict[str, Any] = {"depth": ancestor.depth, "file": _place(ancestor), "sha256": sha256}
    if ancestor.header is not None:
        row |= {key: getattr(ancestor.header, key) for key in _RECORDED}
        row["parents"] = [parent.sha256 for parent in ancestor.header.parents]
    return row


def _place(ancestor: Ancestor) -> str:
    """`run/stage/version` of an artifact in a store, else the file's name."""
    path = ancestor.path
    return "/".join(path.parts[-4:-1]) if path.name == "artifact.h5" else path.name


def recorded(name: str) -> dict[str, Any] | None:
    """What was written about a published artifact, None for one without a record.

    Raises:
        ArtifactError: the record is damaged.
    """
    file = published.FOLDER / f"{name}.json"
    if not file.is_file():
        return None
    try:
        return dict(json.loads(file.read_text(encoding="utf-8")))
    except ValueError as error:
        raise ArtifactError(f"{file}: is damaged; take it from the repository again") from error
