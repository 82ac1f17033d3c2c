"""Selections: which recordings of a dataset are used, and which part of each; one TOML file
each.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from lacoloco.pipelines.errors import StageError
from lacoloco.robots.errors import RobotError
from lacoloco.robots.tables import parse_toml

FOLDER = Path(__file__).parent / "selections"


@dataclass(frozen=True)
class Selection:
    """Recordings by the names of their files without suffix."""

    name: str
    about: str
    trims: Mapping[str, str]
    """Name -> trim, see `trim.Trim`; "" for the whole recording."""

    def chosen(self, paths: Sequence[Path]) -> list[tuple[Path, str]]:
        """Those of the files that are selected, in the order of the selection, with their trims."""
        found: dict[str, list[Path]] = {}
        for path in paths:
            found.setdefault(path.stem, []).append(path)
        return [(p, trim) for name, trim in self.trims.items() for p in found.get(name, ())[:1]]

    def absent(self, paths: Sequence[Path]) -> list[str]:
        """Names that none of the files has."""
        there = {path.stem for path in paths}
        return [name for name in self.trims if name not in there]


def shipped_selections() -> list[str]:
    """Names of the selections that come with lacoloco."""
    return sorted(file.stem for file in FOLDER.glob("*.toml"))


def load_selection(name: str) -> Selection:
    """Read a selection that comes with lacoloco, or a file of one's own.

    Raises:
        StageError: Unknown, unreadable, or not a table of trims; the message names it.
    """
    file = Path(name)
    if name in shipped_selections():
        file = FOLDER / f"{name}.toml"
    elif not file.is_file():
        known = ", ".join(shipped_selections())
        raise StageError(f"--select {name}: neither a file nor one of {known}")
    try:
        table = parse_toml(file.read_text(encoding="utf-8"), str(file))
    except (OSError, RobotError, UnicodeDecodeError) as error:
        raise StageError(f"--select {name}: cannot be read as TOML: {error}") from error
    clips = table.get("clips")
    if not isinstance(clips, dict) or not clips:
        raise StageError(f"--select {name}: has no table [clips] of names and trims")
    trims = {stem: _trim(rows, stem, name) for stem, rows in clips.items()}
    return Selection(Path(name).stem, str(table.get("about", "")), trims)


def _trim(value: Any, stem: str, name: str) -> str:
    """[first, after the last] in frames as text; [] is the whole recording."""
    whole = isinstance(value, list) and all(type(entry) is int and entry >= 0 for entry in value)
    if not whole or len(value) not in (0, 2) or (value and value[0] >= value[1]):
        raise StageError(f"--select {name}: {stem}: use [first frame, frame after the last] or []")
    return f"{value[0]}:{value[1]}" if value else ""
