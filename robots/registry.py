"""The robots that can be asked for, by name or by folder.

A name is the name of a folder with a robot.toml: one that is bundled here, one in a folder of
``LACOLOCO_ROBOTS`` (a list like ``PATH``), or one in ``~/.config/lacoloco/robots``. The first that
has the name is taken, in this order.
"""

from __future__ import annotations

import difflib
import os
from collections.abc import Iterator
from pathlib import Path

from lacoloco.robots.errors import RobotError
from lacoloco.robots.loading import TOML, load_folder
from lacoloco.robots.spec import RobotSpec

BUNDLED = ("solo12", "h1")
VARIABLE = "LACOLOCO_ROBOTS"


def robot_folders() -> dict[str, Path]:
    """Name -> folder of every robot that ``load_robot`` knows by name.

    Raises:
        RobotError: A folder of ``LACOLOCO_ROBOTS`` does not exist.
    """
    found = {name: Path(__file__).parent / name for name in BUNDLED}
    for place in _search_path():
        for toml in sorted(place.glob(f"*/{TOML}")):
            found.setdefault(toml.parent.name, toml.parent)
    return found


def robot_names() -> tuple[str, ...]:
    """Names ``load_robot`` knows."""
    return tuple(robot_folders())


def load_robot(name_or_path: str | Path) -> RobotSpec:
    """A robot by name, or by the path of its folder or of its robot.toml.

    Raises:
        RobotError: Unknown name (the message lists the known ones and the nearest), no robot at
            the path, or a mistake in its files.
    """
    folders = robot_folders()
    if isinstance(name_or_path, str) and name_or_path in folders:
        return _called(name_or_path, folders[name_or_path])
    path = Path(name_or_path).expanduser()
    if isinstance(name_or_path, Path) or path.name != name_or_path or path.exists():
        return load_folder(path)
    near = difflib.get_close_matches(name_or_path.lower(), folders, n=1, cutoff=0.4)
    hint = f"; did you mean {near[0]!r}?" if near else f", or give the path of a folder with {TOML}"
    raise RobotError(f"unknown robot {name_or_path!r}: choose one of {', '.join(folders)}{hint}")


def _called(name: str, folder: Path) -> RobotSpec:
    """The robot in ``folder``, whose own name has to be that of the folder."""
    spec = load_folder(folder)
    if spec.name != name:
        raise RobotError(
            f"{folder / TOML}: name: expected {name!r}, the name of the folder, found {spec.name!r}"
        )
    return spec


def _search_path() -> Iterator[Path]:
    for entry in os.environ.get(VARIABLE, "").split(os.pathsep):
        place = Path(entry).expanduser()
        if entry and not place.is_dir():
            raise RobotError(f"{VARIABLE}: no such folder {entry!r}; list folders of robot folders")
        if entry:
            yield place
    yield Path("~/.config/lacoloco/robots").expanduser()
