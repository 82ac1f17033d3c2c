"""A URDF as it is published -> one that MuJoCo reads: its mesh files found, nothing thrown away."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from xml.etree import ElementTree

from lacoloco.robots.importing.meshes import READ_BY_MUJOCO, as_obj

COMPILER = {"fusestatic": "false", "discardvisual": "false", "strippath": "false"}
"""Keep links that only a fixed joint holds, such as feet, and what is only looked at."""


def prepare(file: Path, converted: Path, notes: list[str]) -> tuple[str, dict[str, float]]:
    """Rewrite the paths of meshes.

    Args:
        file: The URDF.
        converted: Folder for meshes of kinds that MuJoCo does not read, rewritten as OBJ.
        notes: Gets a line about every mesh that is missing.

    Returns:
        The text for MuJoCo, and joint -> speed limit, rad/s, where it says one.
    """
    root = ElementTree.parse(file).getroot()
    for extension in root.findall("mujoco"):
        root.remove(extension)
    extension = ElementTree.SubElement(root, "mujoco")
    ElementTree.SubElement(extension, "compiler", COMPILER)
    missing: dict[str, None] = {}
    for link in root.findall("link"):
        for tag in ("visual", "collision"):
            for shape in link.findall(tag):
                for mesh in shape.iter("mesh"):
                    name = mesh.get("filename", "")
                    found = _readable(_find(name, file), converted)
                    if found is None:
                        missing[name] = None
                        link.remove(shape)
                        break
                    mesh.set("filename", str(found))
    if missing:
        notes.append(f"left out, no such file or none that can be read: {', '.join(missing)}")
    return ElementTree.tostring(root, encoding="unicode"), dict(_speeds(root))


def _find(name: str, file: Path) -> Path | None:
    """The file that a URDF names: ``package://`` is looked for in all folders above it."""
    path = name.split("://", 1)[-1]
    if "://" not in name:
        return file.parent / path
    if name.startswith("file://"):
        return Path(path)
    parts = Path(path).parts
    for folder in file.resolve().parents:
        for skipped in range(len(parts)):
            candidate = folder.joinpath(*parts[skipped:])
            if candidate.is_file():
                return candidate
    return None


def _readable(path: Path | None, converted: Path) -> Path | None:
    """The file, or what it was converted to; None where neither can be had."""
    if path is None or not path.is_file():
        return None
    if path.suffix.lower() in READ_BY_MUJOCO:
        return path.resolve()
    return as_obj(path, converted.absolute())  # MuJoCo looks from elsewhere


def _speeds(root: ElementTree.Element) -> Iterator[tuple[str, float]]:
    for joint in root.findall("joint"):
        limit = joint.find("limit")
        speed = float(limit.get("velocity", "0")) if limit is not None else 0.0
        if speed > 0.0:
            yield joint.get("name", ""), speed
