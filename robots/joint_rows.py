"""Values per joint from rows by joint name or by pattern."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import MISSING, fields
from fnmatch import fnmatchcase
from typing import Any, TypeVar, get_type_hints

from lacoloco.robots.tables import Place, nearest, read_value, refuse_unknown

T = TypeVar("T")
Rows = Mapping[str, Mapping[str, Any]]
"""Joint name or pattern -> key -> value, as TOML has it."""


def joint_rows(kind: type[T], table: Rows, joints: Iterable[str], place: Place) -> list[T]:
    """One ``kind`` per joint from rows by joint name or by pattern (``*`` and ``?``).

    Several rows may speak of a joint, as long as they say different things; the row with the
    joint's own name overrides patterns.

    Raises:
        RobotError: An unknown key or wrong value, a pattern that no joint matches, two patterns
            that say the same of a joint, or a joint of which a value is missing.
    """
    joints = list(joints)
    hints = get_type_hints(kind, include_extras=True)
    for pattern, row in table.items():
        if not any(fnmatchcase(joint, pattern) for joint in joints):
            (place / pattern).fail(f"no joint matches; {nearest(pattern, joints)}")
        refuse_unknown(row, hints, place / pattern)
        for key, value in row.items():
            read_value(hints[key], value, place / pattern / key)
    return [_joint_row(kind, table, joint, place) for joint in joints]


def _joint_row(kind: type[T], table: Rows, joint: str, place: Place) -> T:
    own = dict(table.get(joint, {}))
    said: dict[str, str] = {}
    values: dict[str, Any] = {}
    for pattern, row in table.items():
        if pattern == joint or not fnmatchcase(joint, pattern):
            continue
        for key in row.keys() - own.keys():
            if key in said:
                (place / pattern / key).fail(f"{said[key]!r} says it of joint {joint!r}, too")
            said[key], values[key] = pattern, row[key]
    values |= own
    for member in fields(kind):  # type: ignore[arg-type]
        if member.name not in values and member.default is MISSING:
            place.fail(f"no {member.name!r} for joint {joint!r}")
    hints = get_type_hints(kind, include_extras=True)
    return kind(**{key: read_value(hints[key], v, place) for key, v in values.items()})
