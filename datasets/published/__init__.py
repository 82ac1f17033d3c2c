"""Artifacts that come with lacoloco: trained policies and motions, by name."""

from __future__ import annotations

from pathlib import Path

from lacoloco.datasets.errors import DatasetError
from lacoloco.datasets.hashing import hash_file

FOLDER = Path(__file__).parent


def names() -> tuple[str, ...]:
    """Names of the published artifacts, sorted."""
    return tuple(sorted(path.stem for path in FOLDER.glob("*.h5")))


def find(name: str) -> Path | None:
    """The published artifact of this name, None when there is none."""
    path = FOLDER / f"{name}.h5"
    return path if path.is_file() else None


def find_copy(sha256: str) -> Path | None:
    """The published file with these very bytes, None when there is none."""
    return next((path for path in sorted(FOLDER.glob("*.h5")) if hash_file(path) == sha256), None)


def resolve(name_or_path: str | Path) -> Path:
    """A path as it is, or the published artifact of that name.

    Raises:
        DatasetError: neither a file nor a published name; the message lists the names.
    """
    path = Path(name_or_path)
    if path.is_file():
        return path
    found = find(str(name_or_path))
    if found is None:
        known = ", ".join(names()) or "none"
        raise DatasetError(f"{name_or_path}: no such file, nor a published artifact ({known})")
    return found
