"""Locks between processes. A record lock ends with its process, however that ends."""

from __future__ import annotations

import fcntl
import os
from collections.abc import Iterator
from contextlib import contextmanager
from io import FileIO
from pathlib import Path


@contextmanager
def turn(file: Path) -> Iterator[None]:
    """Wait until no other process is in here with the same file; the file is made when missing.

    Raises:
        OSError: the file cannot be opened, or is a link.
    """
    descriptor = _open(file)
    try:
        fcntl.lockf(descriptor, fcntl.LOCK_EX)
        yield
    finally:
        os.close(descriptor)


def take(file: Path) -> FileIO | None:
    """Lock a file until the result is closed or collected; None while another process has it.

    Within one process it can be taken again; closing any of the results then ends the lock.

    Raises:
        OSError: the file cannot be opened, or is a link.
    """
    stream = FileIO(_open(file), "r+")
    try:
        fcntl.lockf(stream, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except (BlockingIOError, PermissionError):  # POSIX allows both answers
        stream.close()
        return None
    except BaseException:
        stream.close()
        raise
    return stream


def _open(file: Path) -> int:
    # A link could lead to a file of somebody's, and what is there already is never cut.
    return os.open(file, os.O_RDWR | os.O_CREAT | os.O_NOFOLLOW | os.O_CLOEXEC, 0o666)
