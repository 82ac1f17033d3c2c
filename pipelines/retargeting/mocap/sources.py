"""Which recordings a command line means: files, folders and patterns."""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Sequence
from glob import glob, has_magic
from pathlib import Path

from lacoloco.pipelines.errors import StageError

SUFFIX = ".bvh"


def find_recordings(inputs: Sequence[str | Path]) -> list[Path]:
    """Expand inputs into files, each once, in order.

    A folder gives all .bvh files below it, a pattern what it matches, anything else itself, whether
    it exists or not: reading it will say what is wrong with it.

    Raises:
        StageError: A folder or a pattern that gives nothing.
    """
    found: dict[tuple[str, str], Path] = {}
    for item in inputs:
        for path in _expanded(item):
            found.setdefault((os.path.realpath(path), path.stem), path)
    return list(found.values())


def clip_names(paths: Sequence[Path]) -> list[str]:
    """One name per file: its stem, with its ending or the folders above it as far as that is
    ambiguous.
    """
    places = [(os.path.realpath(path.parent), path.stem) for path in paths]
    beside = Counter(places)
    names = own = [
        path.name if beside[place] > 1 else path.stem
        for path, place in zip(paths, places, strict=True)
    ]
    # Resolved and without their root, so that a name never leads out of the folder it is used in.
    folders = [path.resolve().parts[1:-1] for path in paths]
    for depth in range(1, max((len(parts) + 1 for parts in folders), default=1)):
        repeated = {name for name in names if names.count(name) > 1}
        if not repeated:
            break
        names = [
            "/".join([*parts[-depth:], one]) if name in repeated else name
            for name, one, parts in zip(names, own, folders, strict=True)
        ]
    return names


def _expanded(item: str | Path) -> list[Path]:
    path = Path(item)
    if path.exists() or not has_magic(str(item)):
        matches = [path]
    else:
        matches = sorted(Path(match) for match in glob(str(item), recursive=True))
        if not matches:
            raise StageError(f"{item}: matches no file")
    files = [file for match in matches for file in (_inside(match) if match.is_dir() else [match])]
    if not files:
        raise StageError(f"{item}: no {SUFFIX} file in this folder")
    return files


def _inside(folder: Path) -> list[Path]:
    return sorted(p for p in folder.rglob("*") if p.suffix.lower() == SUFFIX and p.is_file())
