"""The robots that can be asked for by name."""

from __future__ import annotations

import difflib
from collections.abc import Callable

from lacoloco.robots.errors import RobotError
from lacoloco.robots.h1 import h1
from lacoloco.robots.solo12 import solo12
from lacoloco.robots.spec import RobotSpec

ROBOTS: dict[str, Callable[[], RobotSpec]] = {"solo12": solo12, "h1": h1}


def robot_names() -> tuple[str, ...]:
    """Names ``load_robot`` knows."""
    return tuple(ROBOTS)


def load_robot(name: str) -> RobotSpec:
    """The robot called ``name``.

    Raises:
        RobotError: Unknown name; the message lists the known ones and the nearest.
    """
    if name in ROBOTS:
        return ROBOTS[name]()
    near = difflib.get_close_matches(name.lower(), ROBOTS, n=1, cutoff=0.4)
    hint = f"; did you mean {near[0]!r}?" if near else ""
    raise RobotError(f"unknown robot {name!r}: choose one of {', '.join(ROBOTS)}{hint}")
