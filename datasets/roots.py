"""Where runs are: which directories hold some, and which of them is taken."""

from __future__ import annotations

from pathlib import Path

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
