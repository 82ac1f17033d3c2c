"""Where an artifact comes from: program version, commit, time, and the files it was made of."""

from __future__ import annotations

import os
import re
import subprocess
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from functools import lru_cache
from importlib import metadata
from pathlib import Path

from lacoloco.datasets import published
from lacoloco.datasets.hashing import hash_file

_PUBLISHED = "published:"
_VERSION_DIRECTORY = re.compile(r"\.?\d{4,}(-[\w.+-]+)?(\.partial)?")


@dataclass(frozen=True)
class Parent:
    """A file that an artifact was made of.

    Attributes:
        path: relative to the artifact's directory when both lie in one runs directory (so that
            it can be moved as a whole); `published:` and a name for what comes with lacoloco;
            absolute otherwise.
        sha256: hash of the file's bytes when it was used.
    """

    path: str
    sha256: str

    def locate(self, artifact: Path) -> Path:
        """The parent's path as seen from the place where `artifact` lies now."""
        if self.path.startswith(_PUBLISHED):
            return published.FOLDER / Path(self.path.removeprefix(_PUBLISHED)).name
        return Path(os.path.normpath(artifact.absolute().parent / self.path))


def describe_parents(
    artifact: Path, parents: Sequence[Path], hashes: Mapping[Path, str] | None = None
) -> list[Parent]:
    """Record the files that the artifact to be written at `artifact` was made of.

    Args:
        artifact: the file to be written.
        parents: what it was made of.
        hashes: absolute path -> SHA-256 of those that were hashed when the work began; they may
            have changed since, or be gone. The others are hashed now.

    Raises:
        ArtifactError: a parent is missing or cannot be read.
    """
    directory = artifact.absolute().parent
    in_store = _VERSION_DIRECTORY.fullmatch(directory.name) and len(directory.parents) > 3
    root = directory.parents[2] if in_store else None
    described = []
    for parent in parents:
        path = Path(parent).absolute()
        inside = root is not None and path.is_relative_to(root)
        name = os.path.relpath(path, directory) if inside else str(path)
        if path.resolve().parent == published.FOLDER.resolve():
            name = _PUBLISHED + path.name
        digest = (hashes or {}).get(path) or hash_file(path)
        described.append(Parent(Path(name).as_posix(), digest))
    return described


def timestamp() -> str:
    """Now, in UTC, as ISO 8601 to the second."""
    return datetime.now(UTC).isoformat(timespec="seconds")


@lru_cache(maxsize=1)
def lacoloco_version() -> str:
    """Version of the installed lacoloco, "unknown" when it was not installed."""
    try:
        return metadata.version("lacoloco")
    except metadata.PackageNotFoundError:
        return "unknown"


@lru_cache(maxsize=1)
def git_commit() -> str:
    """Commit of the checkout that this program runs from, "-dirty" when changed, or ""."""
    checkout = Path(__file__).resolve().parents[1]
    if not (checkout / ".git").exists():  # installed from a wheel, perhaps below another checkout
        return ""
    command = ["git", "-C", str(checkout), "describe", "--always", "--dirty", "--abbrev=40"]
    try:
        result = subprocess.run(command, capture_output=True, text=True, timeout=10, check=False)
    except (OSError, subprocess.TimeoutExpired):
        return ""
    return result.stdout.strip() if result.returncode == 0 else ""
