"""Which column of a foreign motion is which joint of the robot."""

from __future__ import annotations

from collections.abc import Sequence
from difflib import get_close_matches
from pathlib import Path

import numpy as np

from lacoloco.datasets.foreign.motion import ForeignMotion
from lacoloco.pipelines.errors import StageError
from lacoloco.robots.spec import RobotSpec

KINDS = ("model", "breadth-first", "legs")
_ENDING = "_joint"
_SLACK = 0.1
"""Radians beyond its range that a joint of a motion may be off."""
_MOST_BEYOND = 0.5
"""Share of the frames beyond a joint's range from which the order is taken to be wrong."""


def joint_columns(
    spec: RobotSpec, motion: ForeignMotion, asked: str | None
) -> tuple[list[int], list[str]]:
    """The column of each of the robot's J joints, and the names of columns that it has not.

    Args:
        spec: The robot.
        motion: The motion.
        asked: `--joints`: one of ``KINDS``, names joined by commas, or a file with one per line;
            None takes the file's own names, else the order of its format.

    Raises:
        StageError: The order is not known, or joints are missing.
    """
    names = _named(asked) if asked is not None and asked not in KINDS else None
    if names is None and asked is None:
        names = motion.joint_names
    if names is not None:
        return _by_name(spec, motion, names)
    order = asked or motion.joint_order
    if order is None:
        raise StageError(
            f"{motion.name}: a {motion.kind} does not say which column is which joint: say --joints"
            f" {', '.join(KINDS)}, or their names in order"
        )
    ordered = {"model": model_order, "breadth-first": breadth_first, "legs": legs}[order](spec)
    return _by_name(spec, motion, ordered)


def check_ranges(spec: RobotSpec, joint_pos: np.ndarray, name: str, asked: bool) -> list[str]:
    """Remarks on joints (T, J) beyond their ranges.

    Raises:
        StageError: One is so most of the time, and nobody said that the order is right.
    """
    lower, upper = spec.joint_limits()
    beyond = ((joint_pos < lower - _SLACK) | (joint_pos > upper + _SLACK)).mean(axis=0)
    worst = int(beyond.argmax())
    share = f"{100 * beyond[worst]:.0f} % of the frames"
    told = f"{spec.joint_names[worst]} is beyond its range in {share}"
    if beyond[worst] > _MOST_BEYOND and not asked:
        raise StageError(
            f"{name}: {told}; the columns are in another order, or of another robot: say --joints,"
            " or --robot"
        )
    return [f"{name}: {told}"] if beyond[worst] > 0 else []


def model_order(spec: RobotSpec) -> list[str]:
    """The joints in the order of the robot's MJCF, as MuJoCo has them in `qpos`."""
    return list(spec.joint_names)


def breadth_first(spec: RobotSpec) -> list[str]:
    """The joints level by level from the base, as Isaac Lab orders them."""
    return sorted(spec.joint_names, key=lambda joint: _depth(spec, joint))


_LEGS = ("front right", "front left", "rear right", "rear left")


def legs(spec: RobotSpec) -> list[str]:
    """The joints of four legs, front right, front left, rear right, rear left, from the base down.

    Raises:
        StageError: The robot has no four legs that carry all of its joints.
    """
    model = spec.model()
    chains = [_chain(spec, foot) for foot in spec.feet]
    if len(spec.feet) != len(_LEGS) or sum(map(len, chains)) != spec.num_joints:
        raise StageError(
            f"{spec.name}: frames of motion_imitation are of robots on four legs; say --joints"
        )
    bodies = [int(model.joint(chain[0]).bodyid[0]) for chain in chains]
    where = [model.body_pos[body] for body in bodies]
    ordered = sorted(range(len(chains)), key=lambda leg: (-np.sign(where[leg][0]), where[leg][1]))
    return [joint for leg in ordered for joint in chains[leg]]


def _named(asked: str) -> tuple[str, ...]:
    file = Path(asked)
    try:
        text = file.read_text(encoding="utf-8") if file.is_file() else asked
    except (OSError, UnicodeDecodeError) as error:
        raise StageError(f"--joints {asked}: cannot be read as text") from error
    return tuple(name for name in text.replace(",", "\n").split() if name)


def _by_name(
    spec: RobotSpec, motion: ForeignMotion, names: Sequence[str]
) -> tuple[list[int], list[str]]:
    columns = motion.joint_pos.shape[1]
    if len(names) != columns:
        raise StageError(
            f"{motion.name}: has {columns} joints, but {len(names)} are named; say --joints, or"
            f" --robot for another one than {spec.name}"
        )
    plain = [_plain(name) for name in names]
    missing = [joint for joint in spec.joint_names if _plain(joint) not in plain]
    if missing:
        near = get_close_matches(_plain(missing[0]), plain, 1, cutoff=0.4)
        hint = f" (nearest: {near[0]})" if near else ""
        raise StageError(
            f"{motion.name}: has no joint {missing[0]}{hint}; {len(missing)} of the"
            f" {spec.num_joints} of {spec.name} are missing: say --joints, or --robot"
        )
    if len(set(plain)) < len(plain):
        raise StageError(f"{motion.name}: names a joint twice")
    taken = [plain.index(_plain(joint)) for joint in spec.joint_names]
    return taken, [name for index, name in enumerate(names) if index not in taken]


def _plain(name: str) -> str:
    return name.strip().lower().removesuffix(_ENDING)


def _depth(spec: RobotSpec, joint: str) -> int:
    model = spec.model()
    body, depth = int(model.joint(joint).bodyid[0]), 0
    while body:
        body, depth = int(model.body_parentid[body]), depth + 1
    return depth


def _chain(spec: RobotSpec, foot: str) -> list[str]:
    """The joints between the base and a foot, from the base down."""
    model = spec.model()
    body, joints = int(model.body(foot).id), list[str]()
    while body:
        start, count = int(model.body_jntadr[body]), int(model.body_jntnum[body])
        own = [model.joint(index).name for index in range(start, start + count)]
        joints = [name for name in own if name in spec.joint_names] + joints
        body = int(model.body_parentid[body])
    return joints
