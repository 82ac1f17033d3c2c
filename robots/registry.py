"""The robots that can be asked for, by name or by folder.

A name is the name of a folder with a robot.toml: one that is bundled here, one in a folder of
``LACOLOCO_ROBOTS`` (a list like ``PATH``), or one in ``~/.config/lacoloco/robots``. The first that
has the name is taken, in this order.
"""

from __future__ import annotations

import difflib
import os
from collections.abc import Iterator, Mapping
from pathlib import Path

from lacoloco.robots.errors import RobotError
from lacoloco.robots.loading import TOML, load_folder
from lacoloco.robots.spec import RobotSpec

_HERE = Path(__file__).parent
BUNDLED = ("solo12", "h1", "go2")
VARIABLE = "LACOLOCO_ROBOTS"
OWN = "~/.config/lacoloco/robots"
COMES_WITH = "lacoloco"
"""Where the bundled robots come from, in words."""


def robot_folders() -> dict[str, Path]:
    """Name -> folder of every robot that ``load_robot`` knows by name.

    Raises:
        RobotError: A folder of ``LACOLOCO_ROBOTS`` does not exist.
    """
    return {name: folder for name, (folder, _) in _found().items()}


def robot_origins() -> dict[str, str]:
    """Name -> where the robot comes from: ``lacoloco``, ``LACOLOCO_ROBOTS``, or a folder.

    Raises:
        RobotError: A folder of ``LACOLOCO_ROBOTS`` does not exist.
    """
    return {name: origin for name, (_, origin) in _found().items()}


def is_bundled(spec: RobotSpec) -> bool:
    """Whether a robot was read from a folder that comes with lacoloco."""
    return spec.folder.resolve() in {(_HERE / name).resolve() for name in BUNDLED}


def robot_names() -> tuple[str, ...]:
    """Names ``load_robot`` knows."""
    return tuple(robot_folders())


def load_robot(name_or_path: str | Path) -> RobotSpec:
    """A robot by name, or by the path of its folder or of its robot.toml.

    Raises:
        RobotError: Unknown name (the message lists the known ones and the nearest), no robot at
            the path, a mistake in its files, or the robot at the path has the name of another one.
    """
    folders = robot_folders()
    if isinstance(name_or_path, str) and name_or_path in folders:
        return _called(name_or_path, folders[name_or_path])
    path = Path(name_or_path).expanduser()
    if isinstance(name_or_path, Path) or path.name != name_or_path or path.exists():
        return _unlike_namesake(load_folder(path), folders)
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


def _unlike_namesake(spec: RobotSpec, folders: Mapping[str, Path]) -> RobotSpec:
    """A robot from a path, which must not be taken for another one that is known by its name."""
    known = folders.get(spec.name)
    if known is None or known.resolve() == spec.folder.resolve():
        return spec
    if load_folder(known).files() != spec.files():
        raise RobotError(
            f"{spec.folder / TOML}: name: {spec.name!r} is another robot, in {known}; give this one"
            " a name of its own"
        )
    return spec


def _found() -> dict[str, tuple[Path, str]]:
    """Name -> folder and origin."""
    found = {name: (_HERE / name, COMES_WITH) for name in BUNDLED}
    for place, origin in _search_path():
        for toml in sorted(place.glob(f"*/{TOML}")):
            found.setdefault(toml.parent.name, (toml.parent, origin))
    return found


def _search_path() -> Iterator[tuple[Path, str]]:
    """Folders of robot folders, and how the user knows them."""
    for entry in os.environ.get(VARIABLE, "").split(os.pathsep):
        place = Path(entry).expanduser()
        if entry and not place.is_dir():
            raise RobotError(f"{VARIABLE}: no such folder {entry!r}; list folders of robot folders")
        if entry:
            yield place, VARIABLE
    yield Path(OWN).expanduser(), OWN
