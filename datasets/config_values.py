"""Which values a config may have: declared beside each field, checked in one place.

A field's annotation carries its rules, so that they stand where its type stands::

    worlds: Annotated[int, Within(1, 131_072)] = 512
    ramp: Annotated[tuple[float, float], Within(0, 1), Rising()] = (0.3, 0.5)

:func:`check_config` holds types and rules of a whole tree of dataclasses. Rules between fields are
code: a config class that has some says so in a method ``conflict() -> str``.
"""

from __future__ import annotations

import dataclasses
import math
import re
import types
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal, Union, get_args, get_origin, get_type_hints

from lacoloco.datasets.errors import ConfigError

LONGEST_SHOWN = 60
"""Letters of a refused value that a message repeats."""


@dataclass(frozen=True)
class Within:
    """Numbers from ``low`` to ``high``; of a tuple, each of its numbers.

    Attributes:
        low: Smallest value.
        high: Largest value; infinite: no limit, and infinite values are allowed.
        above: ``low`` itself is not allowed.
    """

    low: float
    high: float
    above: bool = False

    def allows(self, value: float) -> bool:
        """Whether a number is in the range; NaN is in none."""
        return (self.low < value if self.above else self.low <= value) and value <= self.high

    def __str__(self) -> str:
        """Say it as in `use a number ...`."""
        if self.high == math.inf:
            return f"above {_number(self.low)}" if self.above else f"from {_number(self.low)}"
        first = f"above {_number(self.low)}, at most" if self.above else f"from {_number(self.low)}"
        return f"{first} {'' if self.above else 'to '}{_number(self.high)}"


@dataclass(frozen=True)
class Rising:
    """The values of a tuple do not fall from one to the next."""

    def allows(self, values: tuple[Any, ...]) -> bool:
        """Whether each value is at least the one before it."""
        return all(first <= second for first, second in zip(values, values[1:], strict=False))

    def __str__(self) -> str:
        """Say it as in `use 2 numbers ...`."""
        return "the lower one first"


@dataclass(frozen=True)
class Length:
    """How many values a tuple has, or how many letters a text."""

    low: int
    high: int

    def allows(self, value: str | tuple[Any, ...]) -> bool:
        """Whether a text or a tuple is as long as it may be."""
        return self.low <= len(value) <= self.high

    def __str__(self) -> str:
        """Say it as in `use ... values`."""
        return f"{self.low} to {self.high:,}"


@dataclass(frozen=True)
class Form:
    """A text of a certain form.

    Attributes:
        pattern: Regular expression that the whole text fulfils.
        words: The same for a person, as in `use ...`.
    """

    pattern: str
    words: str

    def allows(self, value: str) -> bool:
        """Whether the text has the form."""
        return re.fullmatch(self.pattern, value) is not None

    def __str__(self) -> str:
        """Say it."""
        return self.words


Share = Annotated[float, Within(0, 1)]
"""A share of something."""
Ramp = Annotated[tuple[float, float], Within(0, 1), Rising()]
"""Shares of a training between which something rises or falls."""
Anneal = tuple[Annotated[float, Within(0, 1, above=True)], Share, Share]
"""What a value falls to, as a share of itself, and the shares of the training between which."""
Worlds = Annotated[int, Within(1, 131_072)]
"""Parallel worlds."""
Steps = Annotated[int, Within(1, 10**12)]
"""Control steps or decisions of a whole training."""
Factor = Annotated[float, Within(0, 1e6)]
"""A weight or a factor."""
PositiveFactor = Annotated[float, Within(0, 1e6, above=True)]
"""A factor that may not be zero."""
Std = Annotated[float, Within(0, 100, above=True)]
"""A standard deviation of noise."""
LearningRate = Annotated[float, Within(0, 1, above=True)]
"""A step size of an optimiser."""
Seconds = Annotated[float, Within(0, 3600)]
"""A time, perhaps none."""
Widths = Annotated[tuple[int, ...], Length(1, 8), Within(1, 4096)]
"""Widths of a network's hidden layers."""
Text = Annotated[str, Length(0, 1000)]
"""A text for people."""


def check_config(config: Any, where: str = "") -> None:
    """Hold every field of a config, and of the configs in it, to its type and its rules.

    Args:
        config: A dataclass.
        where: How a message names the config that this one is part of, with a dot at its end.

    Raises:
        ConfigError: The first field that is not as declared; the message names it by its dotted
            path, with its value and what is allowed.
    """
    for name, hint in fields_of(type(config)):
        value, path = getattr(config, name), f"{where}{name}"
        if dataclasses.is_dataclass(hint):
            if type(value) is not hint:
                raise ConfigError(f"{path}={_shown(value)}: use a group of fields")
            check_config(value, f"{path}.")
        else:
            check_value(value, hint, f"{path}={_shown(value)}")
    conflict = getattr(config, "conflict", None)
    if conflict is not None and (told := conflict()):
        raise ConfigError(f"{where}{told}")


def check_value(value: Any, hint: Any, called: str) -> None:
    """Hold one value to the annotation of its field.

    Args:
        value: The value.
        hint: The annotation, with its rules.
        called: How a message names field and value, as they were given.

    Raises:
        ConfigError: It is not as declared.
    """
    if not _fits(value, hint):
        raise ConfigError(f"{called}: use {allowed(hint)}")


def fields_of(kind: type) -> Iterator[tuple[str, Any]]:
    """(name, annotation with its rules) of every field of a dataclass."""
    hints = get_type_hints(kind, include_extras=True)
    for field in dataclasses.fields(kind):
        yield field.name, hints[field.name]


def is_ruled(hint: Any) -> bool:
    """Whether an annotation bounds its values: by rules, or because its type has few."""
    bare, rules = _apart(hint)
    origin, inner = get_origin(bare), get_args(bare)
    if origin in (Union, types.UnionType):
        return all(is_ruled(arm) for arm in inner if arm is not type(None))
    if rules or bare is bool or origin is Literal:
        return True
    fixed = origin is tuple and Ellipsis not in inner
    return fixed and all(is_ruled(item) for item in inner)


def allowed(hint: Any) -> str:
    """What an annotation allows, in words that follow `use`."""
    bare, rules = _apart(hint)
    origin, inner = get_origin(bare), get_args(bare)
    if origin in (Union, types.UnionType):
        some = [allowed(arm) for arm in inner if arm is not type(None)]
        return " or ".join([*some, *(["none"] if type(None) in inner else [])])
    if origin is Literal:
        return "one of " + ", ".join(str(choice) or "nothing" for choice in inner)
    if origin is tuple:
        return _allowed_tuple(inner, rules)
    if bare is bool:
        return "true or false"
    if bare in (int, float):
        noun = "a whole number" if bare is int else "a number"
        return " ".join([noun, *map(str, rules)])
    forms = [str(rule) for rule in rules if isinstance(rule, Form)]
    longest = [rule.high for rule in rules if isinstance(rule, Length)]
    return ", ".join([*(forms or ["a text"]), *(f"at most {n:,} letters" for n in longest)])


def _allowed_tuple(inner: tuple[Any, ...], rules: list[Any]) -> str:
    count = next((str(rule) for rule in rules if isinstance(rule, Length)), "any number of")
    within = [str(rule) for rule in rules if not isinstance(rule, Length)]
    if Ellipsis in inner:
        noun = {int: "whole numbers", float: "numbers"}.get(_apart(inner[0])[0])
        items = noun or f"times ({allowed(inner[0])})"
        return ", ".join([" ".join([count, items, *within[:1]]), *within[1:]])
    if len(set(inner)) == 1 and not _apart(inner[0])[1]:
        noun = "whole numbers" if inner[0] is int else "numbers"
        return ", ".join([" ".join([f"{len(inner)} {noun}", *within[:1]]), *within[1:]])
    return ", ".join([*(allowed(item) for item in inner), *within])


def _fits(value: Any, hint: Any) -> bool:
    bare, rules = _apart(hint)
    origin, inner = get_origin(bare), get_args(bare)
    if origin in (Union, types.UnionType):
        return any(_fits(value, arm) for arm in inner)
    if origin is Literal:
        return any(type(value) is type(choice) and value == choice for choice in inner)
    if origin is tuple:
        if not isinstance(value, tuple):
            return False
        items = inner[:1] * len(value) if Ellipsis in inner else inner
        if len(items) != len(value) or not all(map(_fits, value, items)):
            return False
        numbers = [rule for rule in rules if isinstance(rule, Within)]
        whole = [rule for rule in rules if not isinstance(rule, Within)]
        each = all(rule.allows(number) for rule in numbers for number in value)
        return each and all(rule.allows(value) for rule in whole)
    return _is_a(value, bare) and all(rule.allows(value) for rule in rules)


def _is_a(value: Any, kind: Any) -> bool:
    """Whether a value is of a plain type; a whole number is also a float, a bool is no number."""
    if kind is float:
        return isinstance(value, (int, float)) and not isinstance(value, bool) and value == value
    if kind is int:
        return isinstance(value, int) and not isinstance(value, bool)
    return value is None if kind is type(None) else isinstance(value, get_origin(kind) or kind)


def _apart(hint: Any) -> tuple[Any, list[Any]]:
    """An annotation without its rules, and the rules."""
    if get_origin(hint) is Annotated:
        bare, *rules = get_args(hint)
        return bare, list(rules)
    return hint, []


def _number(value: float) -> str:
    if value == int(value) and abs(value) < 1e7:
        return f"{int(value):,}"
    return f"{value:g}"


def _shown(value: Any) -> str:
    text = str(value) if isinstance(value, (str, Path)) else repr(value)
    text = text[1:-1] if isinstance(value, tuple) else text
    return text if len(text) <= LONGEST_SHOWN else f"{text[:LONGEST_SHOWN]}..."
