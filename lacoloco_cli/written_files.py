"""Files that are written where the user asked for them: nothing that exists is lost by it.

A file is only replaced by one of its own kind, in one step, and never among the runs, where stages
write.
"""

from __future__ import annotations

import os
import stat
from collections.abc import Sequence
from pathlib import Path

from lacoloco_cli.failures import UserError

STARTS = {
    "PNG": (b"\x89PNG\r\n\x1a\n",),
    "GIF": (b"GIF87a", b"GIF89a"),
    "PDF": (b"%PDF-",),
    "PS": (b"%!PS",),
    "EPS": (b"%!PS",),
    "JPG": (b"\xff\xd8\xff",),
    "JPEG": (b"\xff\xd8\xff",),
    "TIF": (b"II*\x00", b"MM\x00*"),
    "TIFF": (b"II*\x00", b"MM\x00*"),
    "WEBP": (b"RIFF",),
}
"""Kind -> how its files begin."""
PICTURES = ("png", "pdf", "svg")
"""Kinds of a figure; matplotlib writes more, which few programs show."""
PAGE = "page of lacoloco"
RUN_PAGE = "page of a run"
TEXT = "text"
_RUN = b'content="lacoloco-run"'
_MARKS = {
    RUN_PAGE: (b"<!doctype html>", _RUN),
    PAGE: (b"<!doctype html>", b"meshcat-pane"),
    "SVG": (b"<svg",),
}
"""Kind -> what stands near the beginning of its files, in lower case."""
_LOOKED_AT = 8192


def check_ending(option: str, file: Path, endings: Sequence[str]) -> str:
    """The kind of file that a name asks for: nothing is written under the name of another kind.

    Args:
        option: What named the file, e.g. `--out`.
        file: Where something will be written.
        endings: Kinds that can be written there, e.g. "png".

    Returns:
        One of the endings.

    Raises:
        UserError: The name ends in none of them.
    """
    kind = file.suffix.removeprefix(".").lower()
    if kind not in endings:
        known = " or ".join(f".{one}" for one in endings)
        raise UserError(f"{option} {file}: give it a name that ends in {known}")
    return kind


def check_output(option: str, file: Path, kind: str, runs: Path) -> Path:
    """Refuse, before the work, a place where something would be lost or nothing can be written.

    Args:
        option: What named the file, e.g. `--out`.
        file: Where something will be written; a link is followed.
        kind: `PAGE`, `TEXT`, or a picture's kind by its usual ending, e.g. "png".
        runs: Directory of all runs.

    Returns:
        The place with all links followed.

    Raises:
        UserError: It lies among runs, is there and of another kind, or cannot be written.
    """
    place = Path(os.path.realpath(file))
    if among_runs(place, runs):
        raise UserError(
            f"{option} {file}: runs hold what stages write; name a file outside of them"
        )
    if place.is_dir() or not os.access(place.parent, os.W_OK):
        raise UserError(f"{option} {file}: cannot be written there; name a file in another folder")
    try:
        replaceable = not place.exists() or is_of_kind(place, kind)
    except OSError as error:
        raise UserError(f"{option} {file}: {error.strerror}; name another file") from error
    if not replaceable:
        name = kind if kind in (PAGE, RUN_PAGE, TEXT) else kind.upper()
        raise UserError(f"{option} {file}: exists and is not a {name}; name another file")
    return place


def among_runs(place: Path, runs: Path) -> bool:
    """Whether a place lies in the directory of runs, or in another one of that kind."""
    from lacoloco.datasets.roots import is_root

    return place.is_relative_to(runs.resolve()) or any(map(is_root, place.parents))


def is_of_kind(file: Path, kind: str) -> bool:
    """Whether an existing file is what would be written, as far as its beginning tells.

    Raises:
        OSError: It cannot be read.
    """
    if not stat.S_ISREG(file.stat().st_mode):
        return False
    with file.open("rb") as stream:
        start = stream.read(_LOOKED_AT)
    if not start:
        return True
    if kind == TEXT:
        return _is_text(file)
    if kind == "mp4":
        return start[4:8] == b"ftyp"  # after the length of its first part
    if marks := _MARKS.get(kind) or _MARKS.get(kind.upper()):
        return all(mark in start.lower() for mark in marks)
    return start.startswith(STARTS.get(kind.upper(), (b"\0",)))


def _is_text(file: Path) -> bool:
    content = file.read_bytes()
    try:
        content.decode("utf-8")
    except UnicodeDecodeError:
        return False
    return b"\0" not in content


def copy_to(option: str, made: Path, file: Path) -> None:
    """Copy what a stage made to where it was asked for, in one step.

    Args:
        option: What named the file.
        made: The stage's file.
        file: From `check_output`.

    Raises:
        UserError: The file system refuses; what was there is as it was.
    """
    from lacoloco.datasets.atomic_write import write_file
    from lacoloco.datasets.errors import ArtifactError

    try:
        write_file(file, made.read_bytes(), replace=True)
    except ArtifactError as error:
        reason = error.__cause__.strerror if isinstance(error.__cause__, OSError) else error
        raise UserError(f"{option} {file}: {reason}; it is in {made}") from error
