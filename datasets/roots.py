"""Where runs are: which directories hold some, and which of them is taken."""

from __future__ import annotations

from contextlib import suppress
from pathlib import Path

from lacoloco.datasets.atomic_write import write_file

NUMBERING = ".numbering"
"""File in a directory of runs that is locked while a version is begun, looked for or completed."""


def is_root(directory: Path) -> bool:
    """Whether a directory holds runs."""
    return (directory / NUMBERING).is_file()


def nearest_root() -> Path:
    """Where runs are looked for by default: `runs` here, or the nearest above that holds some."""
    here = Path("runs")
    try:
        working = Path.cwd()
    except OSError:  # somebody has removed it
        return here
    above = (folder / "runs" for folder in working.parents)
    return here if here.exists() else next(filter(is_root, above), here)


def check_writable(directory: Path) -> None:
    """See whether runs can be written to a directory, before the work rather than after it.

    Raises:
        ArtifactError: The file system refuses.
    """
    probe = directory / ".writable"
    write_file(probe, b"", replace=True)
    with suppress(FileNotFoundError):  # another call was quicker
        probe.unlink()
