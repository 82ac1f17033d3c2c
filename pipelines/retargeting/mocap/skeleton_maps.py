"""Which joints of a recording belong to which frames of a robot: data, one TOML file per
skeleton.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from difflib import SequenceMatcher
from functools import lru_cache
from pathlib import Path
from typing import Any, get_args

from lacoloco.datasets.errors import DatasetError
from lacoloco.datasets.mocap import UpAxis, read_bvh
from lacoloco.datasets.samples import SAMPLES
from lacoloco.pipelines.errors import StageError
from lacoloco.robots.errors import RobotError
from lacoloco.robots.tables import parse_toml

FOLDER = Path(__file__).parent / "maps"
RULES = ("limbs", "height")
"""Scale rules that are words; a factor is one, too."""


@dataclass(frozen=True)
class SkeletonMap:
    """From one kind of skeleton to one robot."""

    name: str
    about: str
    robot: str
    up_axis: UpAxis
    """Axis of the files that points up."""
    unit: float
    """Metres per unit of the files."""
    scale: str
    """"limbs", "height" (see `targets.natural_scale`) or a factor."""
    keypoints: Mapping[str, str]
    """Joint -> frame of the robot."""
    contacts: Mapping[str, tuple[str, ...]]
    """Foot of the robot -> nodes that touch the ground, the first that a file has."""
    limb: float = 0.0
    """Usual length from hip to ground, m, from which a wrong unit is told; 0 for any."""
    also: tuple[str, ...] = ()
    """Joints that only tell these files from others."""

    def missing(self, joints: Sequence[str]) -> list[str]:
        """Joints that the map needs and a skeleton lacks."""
        return [joint for joint in (*self.keypoints, *self.also) if joint not in joints]


def load_map(path: Path) -> SkeletonMap:
    """Read a map.

    Raises:
        StageError: Missing, not TOML, or a key that is wrong; the message names file and key.
    """
    path = Path(path)
    try:
        table = parse_toml(path.read_text(encoding="utf-8"), str(path))
    except OSError as error:
        raise StageError(f"{path}: cannot be read: {error.strerror}") from error
    except UnicodeDecodeError as error:
        raise StageError(f"{path}: not TOML: {error}") from error
    except RobotError as error:
        raise StageError(str(error)) from error
    return map_of(table, path.stem, str(path))


def map_of(table: Mapping[str, Any], name: str, where: str) -> SkeletonMap:
    """A map from the table of its file.

    Raises:
        StageError: See `load_map`.
    """

    def take(key: str, kind: type | tuple[type, ...], default: Any = None) -> Any:
        value = table.get(key, default)
        if not isinstance(value, kind):
            raise StageError(f"{where}: '{key}' is missing or wrong; see maps/mann-dog.toml")
        return value

    known = {"about", "robot", "up_axis", "unit", "scale", "keypoints", "contacts", "limb", "also"}
    if unknown := sorted(set(table) - known):
        raise StageError(f"{where}: unknown key '{unknown[0]}'; use {', '.join(sorted(known))}")
    up_axis, scale = take("up_axis", str, "y"), str(take("scale", (str, int, float), "limbs"))
    if up_axis not in get_args(UpAxis):
        raise StageError(f"{where}: up_axis '{up_axis}'; use one of {', '.join(get_args(UpAxis))}")
    if scale not in RULES and not _positive(scale):
        raise StageError(f"{where}: scale '{scale}'; use {', '.join(RULES)} or a positive factor")
    keypoints, contacts = take("keypoints", dict), take("contacts", dict, {})
    if not all(isinstance(frame, str) for frame in keypoints.values()):
        raise StageError(f"{where}: [keypoints] maps joints of the file to frames of the robot")
    if len(set(keypoints.values())) < len(keypoints):
        raise StageError(f"{where}: [keypoints] names a frame of the robot twice")
    feet = {foot: [nodes] if isinstance(nodes, str) else nodes for foot, nodes in contacts.items()}
    if not all(isinstance(nodes, list) and nodes for nodes in feet.values()) or not all(
        isinstance(node, str) for nodes in feet.values() for node in nodes
    ):
        raise StageError(f"{where}: [contacts] gives each foot of the robot nodes of the file")
    limb, also = float(take("limb", (int, float), 0.0)), take("also", list, [])
    if limb < 0.0 or not all(isinstance(joint, str) for joint in also):
        raise StageError(f"{where}: 'limb' is a length in metres, 'also' a list of joints")
    return SkeletonMap(
        name=name,
        about=take("about", str, ""),
        robot=take("robot", str),
        up_axis=up_axis,
        unit=float(take("unit", (int, float), 0.01)),
        scale=scale,
        keypoints=keypoints,
        contacts={foot: tuple(nodes) for foot, nodes in feet.items()},
        limb=limb,
        also=tuple(also),
    )


@lru_cache(maxsize=1)
def shipped_maps() -> tuple[SkeletonMap, ...]:
    """The maps that come with lacoloco, by name."""
    return tuple(load_map(file) for file in sorted(FOLDER.glob("*.toml")))


def choose_map(
    maps: Sequence[SkeletonMap], robot: str, joints: Sequence[str], file: str
) -> SkeletonMap:
    """The map that fits the joints of a file: of several, the one that uses most of them.

    Args:
        maps: To choose from.
        robot: Name of the robot.
        joints: Nodes of the file.
        file: What to call it in an error.

    Raises:
        StageError: No map leads to this robot.
        DatasetError: No map fits; the message names the nearest and what it misses.
    """
    maps = [candidate for candidate in maps if candidate.robot == robot]
    if not maps:
        raise StageError(
            f"robot '{robot}': no map gives it keypoints; copy one of {FOLDER}, set its robot, and"
            " name it with --map"
        )
    fitting = [candidate for candidate in maps if not candidate.missing(joints)]
    if fitting:
        return max(fitting, key=_joints_used)
    nearest = max(maps, key=lambda candidate: _likeness(candidate, joints))
    raise DatasetError(
        f"{file}: its joints fit no map; the nearest, '{nearest.name}', needs"
        f" {', '.join(nearest.missing(joints))}, and the file has {', '.join(joints)};"
        " write a map of its joints and name it with --map"
    )


def other_robot(
    maps: Sequence[SkeletonMap], chosen: SkeletonMap, joints: Sequence[str]
) -> SkeletonMap | None:
    """The map to another robot that uses more joints of a file than the chosen one, if any does."""
    fitting = [m for m in maps if m.robot != chosen.robot and not m.missing(joints)]
    best = max(fitting, key=_joints_used, default=None)
    return best if best is not None and _joints_used(best) > _joints_used(chosen) else None


def sample_for(robot: str, maps: Sequence[SkeletonMap]) -> Path:
    """The bundled recording that a map to this robot fits; the first where none does."""
    for sample in SAMPLES:
        joints = read_bvh(sample).joint_names
        if any(m.robot == robot and not m.missing(joints) for m in maps):
            return sample
    return SAMPLES[0]


def _joints_used(candidate: SkeletonMap) -> int:
    return len(candidate.keypoints) + len(candidate.also)


def _likeness(candidate: SkeletonMap, joints: Sequence[str]) -> float:
    """Share of the map's joints that the file has, a similar name counting in part."""

    def nearest(joint: str) -> float:
        return max(
            (SequenceMatcher(None, joint.lower(), other.lower()).ratio() for other in joints),
            default=0.0,
        )

    return sum(nearest(joint) for joint in candidate.keypoints) / len(candidate.keypoints)


def _positive(text: str) -> bool:
    try:
        return 0.0 < float(text) < float("inf")
    except ValueError:
        return False
