"""Files that are either there as a whole or not at all."""

from __future__ import annotations

import os
import secrets
from contextlib import suppress
from pathlib import Path

from lacoloco.datasets.errors import ArtifactError, storage_errors

TEMPORARY = ".writing-"
"""Beginning of the names of files that are being written."""


def write_file(path: Path, content: bytes, *, replace: bool = False) -> Path:
    """Write `content` so that a reader, or a killed writer, never leaves or sees half a file.

    The bytes go to a temporary name in the same directory, are forced to disk, and the file then
    takes its name in one step. The directory is made when it is missing.

    Args:
        path: the name to take.
        content: all bytes of the file.
        replace: whether a file of that name may be replaced (checkpoints); artifacts never are.

    Raises:
        ArtifactError: the name is taken, or the file system refuses (read-only, full...).
    """
    # Short, as the file's own name may be as long as the file system allows.
    temporary = path.parent / f"{TEMPORARY}{os.getpid()}-{secrets.token_hex(4)}"
    with storage_errors(path, "write"):
        path.parent.mkdir(parents=True, exist_ok=True)
        if path.exists() and not replace:
            raise ArtifactError(f"{path}: exists already and is never overwritten; choose another")
        try:
            with temporary.open("xb") as stream:  # new, so that no link leads elsewhere
                stream.write(content)
                stream.flush()
                os.fsync(stream.fileno())
            os.replace(temporary, path)
        except BaseException:
            with suppress(OSError):
                temporary.unlink(missing_ok=True)
            raise
        sync_directory(path.parent)
    return path


def sync_directory(directory: Path) -> None:
    """Force the names in a directory to disk, so that a rename survives a power cut."""
    descriptor = os.open(directory, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def remove_leftovers(directory: Path) -> None:
    """Delete the temporary files that killed writers left in a directory."""
    for leftover in directory.glob(f"{TEMPORARY}*"):
        leftover.unlink(missing_ok=True)


def abandoned(directory: Path) -> list[Path]:
    """The temporary files in a directory whose writer does not run any more, on this machine."""
    found = []
    for path in sorted(directory.glob(f"{TEMPORARY}*")):
        writer = path.name.removeprefix(TEMPORARY).partition("-")[0]
        if not (writer.isdecimal() and _runs(int(writer))):
            found.append(path)
    return found


def _runs(process: int) -> bool:
    try:
        os.kill(process, 0)
    except (ProcessLookupError, OverflowError):
        return False
    except PermissionError:  # somebody else's
        return True
    return True
