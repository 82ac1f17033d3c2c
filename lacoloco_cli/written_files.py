"""Files that are written where the user asked for them."""

from __future__ import annotations

import os
from pathlib import Path

from lacoloco_cli.failures import UserError


def check_writable(option: str, file: Path) -> None:
    """Refuse a place that cannot be written before the work, not after it.

    Args:
        option: What named the file, e.g. `--out`.
        file: Where something will be written.

    Raises:
        UserError: Its folder is missing or read-only, or it is a folder itself.
    """
    folder = file.absolute().parent
    if file.is_dir() or not os.access(folder, os.W_OK):
        raise UserError(f"{option} {file}: cannot be written there; name a file in another folder")


def copy_to(option: str, made: Path, file: Path) -> None:
    """Copy what a stage made to where it was asked for.

    Raises:
        UserError: The file system refuses.
    """
    try:
        file.write_bytes(made.read_bytes())
    except OSError as error:
        raise UserError(f"{option} {file}: {error.strerror}; it is in {made}") from error
