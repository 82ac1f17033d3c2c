"""`--show-config`: every key of a stage's config with its value, range, unit and meaning.

Meaning and unit are read from the docstrings of the config classes, so that they stand in one
place: a line `name: meaning [unit].` below `Attributes:`. What is allowed stands in the field's
annotation (`lacoloco.datasets.config_values`).
"""

from __future__ import annotations

import dataclasses
import inspect
import re
import types
from collections.abc import Iterator
from typing import Any, Literal, Union, get_args, get_origin, get_type_hints

_ENTRY = re.compile(r"(\w+): (.+)")
_UNIT = re.compile(r"\s*\[([^\]\d][^\]]*)\](?=[.;,]|\s|$)")


@dataclasses.dataclass(frozen=True)
class Key:
    """One field that `--set` can change.

    Attributes:
        key: dotted path.
        value: what the stage would use.
        type: as a person writes it.
        allowed: which values of this type.
        unit: empty for what has none.
        meaning: one or a few sentences; empty where the class does not say.
    """

    key: str
    value: Any
    type: str
    allowed: str
    unit: str
    meaning: str


def keys_of(config: Any, prefix: str = "") -> Iterator[Key]:
    """Every key of a config, groups opened, in the order of the fields."""
    from lacoloco.datasets.config_values import allowed, fields_of

    told = documented(type(config))
    hints = get_type_hints(type(config))
    for name, ruled in fields_of(type(config)):
        value, path = getattr(config, name), prefix + name
        if dataclasses.is_dataclass(value):
            yield from keys_of(value, f"{path}.")
        else:
            meaning, unit = told.get(name, ("", ""))
            yield Key(path, value, type_text(hints[name]), allowed(ruled), unit, meaning)


COLUMNS = {"key": 36, "value": 14, "unit": 13, "meaning, and what is allowed": None}
"""Heading of the table for a person -> most characters in a line."""


def row_of(key: Key) -> list[str]:
    """The cells of one key in the table for a person."""
    sentences = (key.meaning.rstrip("."), key.allowed)
    text = " ".join(f"{one[:1].upper()}{one[1:]}." for one in sentences if one)
    return [key.key, value_text(key.value), key.unit, text]


def documented(kind: type) -> dict[str, tuple[str, str]]:
    """Field -> (meaning, unit), from the docstrings of a class and of those it extends."""
    told: dict[str, tuple[str, str]] = {}
    for one in reversed(kind.__mro__):
        told |= {name: _unit_apart(text) for name, text in _attributes(one)}
    return told


def type_text(hint: Any) -> str:
    """A type as a person writes it: `int`, `float or none`, `clip|paper`, `floats`, `2 floats`."""
    origin, inner = get_origin(hint), get_args(hint)
    if origin in (Union, types.UnionType):
        some = [type_text(arm) for arm in inner if arm is not type(None)]
        return " or ".join([*some, *(["none"] if type(None) in inner else [])])
    if origin is Literal:
        return "|".join(str(choice) or '""' for choice in inner)
    if origin is tuple:
        if len(inner) == 2 and inner[1] is Ellipsis:
            return f"list of {type_text(inner[0])}"
        return f"({', '.join(type_text(item) for item in inner)})"
    return getattr(hint, "__name__", str(hint))


def value_text(value: Any) -> str:
    """A value as `--set` reads it."""
    if isinstance(value, tuple):
        inner = ",".join(value_text(item) for item in value)
        return f"({inner})" if any(isinstance(item, tuple) for item in value) else inner or "()"
    if value is None:
        return "none"
    if isinstance(value, bool):
        return str(value).lower()
    return str(value)


def _attributes(kind: type) -> Iterator[tuple[str, str]]:
    """(name, text) of every entry below `Attributes:`; lines that are indented further go on."""
    text = inspect.cleandoc(kind.__dict__.get("__doc__") or "")
    _, _, section = text.partition("\nAttributes:\n")
    name, parts = "", list[str]()
    for line in section.splitlines():
        if line and not line.startswith(" "):
            break
        entry = _ENTRY.fullmatch(line.removeprefix("    "))
        if entry:
            if name:
                yield name, " ".join(parts)
            name, parts = entry[1], [entry[2]]
        elif line.strip():
            parts.append(line.strip())
    if name:
        yield name, " ".join(parts)


def _unit_apart(text: str) -> tuple[str, str]:
    """Meaning without the unit in brackets, and the unit."""
    found = list(_UNIT.finditer(text))
    if not found:
        return text, ""
    begin, end = found[-1].span()
    return (text[:begin] + text[end:]).strip(), found[-1][1]
