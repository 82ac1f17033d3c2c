"""The MJCF of a robot as text: read by MuJoCo and by Pinocchio, with or without its folder."""

from __future__ import annotations

import tempfile
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING
from xml.etree import ElementTree

from lacoloco.robots.errors import RobotError

if TYPE_CHECKING:
    import mujoco
    import pinocchio


def parse(text: str, file: Path) -> mujoco.MjSpec:
    """A new, editable MuJoCo spec of the MJCF ``text``.

    Args:
        text: The MJCF.
        file: The file it was read from. Meshes are found beside it. Where it is gone or holds
            another text by now, the shapes that need a mesh are left out: they are only looked at.

    Raises:
        RobotError: MuJoCo cannot read it; the message names the file.
    """
    import mujoco

    mujoco.set_mju_user_warning(_ignored)
    try:
        if _is_stored_in(file, text):
            return mujoco.MjSpec.from_file(str(file))
        return mujoco.MjSpec.from_string(without_meshes(text))
    except (ValueError, ElementTree.ParseError) as error:
        raise RobotError(f"{file}: MuJoCo cannot load it: {_first_line(error)}") from error


def _ignored(warning: str) -> None:
    """Take MuJoCo's warnings, which it would else write to MUJOCO_LOG.TXT where the user is.

    A world that diverges is counted by the engine.
    """


@lru_cache(maxsize=8)
def bare_model(text: str, file: Path) -> mujoco.MjModel:
    """The compiled model of :func:`parse`. Shared: read it, do not write to it.

    Raises:
        RobotError: MuJoCo cannot compile it; the message names the file.
    """
    try:
        return parse(text, file).compile()
    except ValueError as error:
        if isinstance(error, RobotError):
            raise
        raise RobotError(f"{file}: MuJoCo cannot load it: {_first_line(error)}") from error


def pinocchio_model(text: str, file: Path) -> pinocchio.Model:
    """A new Pinocchio model of the MJCF ``text``; Pinocchio reads files only."""
    import pinocchio

    with tempfile.TemporaryDirectory(prefix="lacoloco-mjcf-") as folder:
        copy = Path(folder) / file.name
        copy.write_bytes(without_meshes(text).encode())
        return pinocchio.buildModelFromMJCF(str(copy))


def without_meshes(text: str) -> str:
    """The MJCF without what needs a further file: meshes, the shapes made of them, textures.

    A text that needs none is returned as it is.
    """
    root = ElementTree.fromstring(text)
    assets = [(group, item) for group in root.iter("asset") for item in group if item.get("file")]
    if not assets:
        return text
    gone = {(item.tag, item.get("name") or Path(item.get("file", "")).stem) for _, item in assets}
    for group, item in assets:
        group.remove(item)
    for parent in list(root.iter()):
        for child in list(parent):
            if child.tag == "geom" and ("mesh", child.get("mesh")) in gone:
                parent.remove(child)
            elif child.tag == "material" and ("texture", child.get("texture")) in gone:
                del child.attrib["texture"]
    return ElementTree.tostring(root, encoding="unicode")


def _is_stored_in(file: Path, text: str) -> bool:
    return file.is_file() and file.read_bytes() == text.encode()


def _first_line(error: Exception) -> str:
    return (str(error).splitlines() or [type(error).__name__])[0]
