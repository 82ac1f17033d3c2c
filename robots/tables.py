"""Tables of a TOML file, read into frozen dataclasses by the types of their fields.

Every mistake is one line that names the file, the key and what is expected there. A type can ask
for more than its kind by an annotation: ``Positive``, ``NonNegative``, ``Share``, ``Range``.
"""

from __future__ import annotations

import difflib
import math
import reprlib
import tomllib
import types
from collections.abc import Callable, Iterable, Mapping
from dataclasses import MISSING, Field, dataclass, fields, is_dataclass
from typing import Annotated, Any, NoReturn, TypeVar, Union, get_args, get_origin, get_type_hints

from lacoloco.robots.errors import RobotError

T = TypeVar("T")

PI = 3.1416  # as it is written by hand


@dataclass(frozen=True)
class Rule:
    """What a value has to be beyond its type, and how that is said."""

    expected: str
    holds: Callable[[Any], bool]


Positive = Annotated[float, Rule("a number above 0", lambda x: x > 0)]
NonNegative = Annotated[float, Rule("a number of at least 0", lambda x: x >= 0)]
Length = Annotated[float, Rule("a length in metres, above 0 and at most 10", lambda x: 0 < x <= 10)]
Angle = Annotated[float, Rule("an angle in radians, above 0 and at most pi", lambda x: 0 < x <= PI)]
Share = Annotated[float, Rule("a number between 0 and 1", lambda x: 0 <= x <= 1)]
Range = Annotated[
    tuple[float, float], Rule("two numbers, the smaller one first", lambda pair: pair[0] <= pair[1])
]
Vector = tuple[float, float, float]


@dataclass(frozen=True)
class Place:
    """A key of a file, for messages.

    Attributes:
        file: The file, as the reader of the message knows it.
        key: The key with its tables, e.g. ``contacts.feet``; empty for the file itself.
    """

    file: str
    key: str = ""

    def __truediv__(self, key: str | int) -> Place:
        """The place of a key, or of an item, inside this one."""
        if isinstance(key, int):
            return Place(self.file, f"{self.key}[{key}]")
        shown = key if key.replace("_", "").replace("-", "").isalnum() else f'"{key}"'
        return Place(self.file, f"{self.key}.{shown}" if self.key else shown)

    def fail(self, problem: str) -> NoReturn:
        """Raise the one line that names the file, the key and the problem."""
        raise RobotError(f"{self.file}: {f'{self.key}: ' if self.key else ''}{problem}")

    def expected(self, what: str, found: object) -> NoReturn:
        """Raise for a value that is not ``what`` is expected here."""
        self.fail(f"expected {what}, found {shown_value(found)}")


def parse_toml(text: str, file: str) -> dict[str, Any]:
    """The tables of a TOML text.

    Raises:
        RobotError: It is not TOML; the message names the file and the line.
    """
    try:
        return tomllib.loads(text)
    except (tomllib.TOMLDecodeError, ValueError) as error:  # also a number of too many digits
        raise RobotError(f"{file}: not a TOML file: {str(error).splitlines()[0]}") from error
    except RecursionError as error:
        raise RobotError(f"{file}: its tables or lists lie too deep in each other") from error


def read_table(kind: type[T], values: object, place: Place) -> T:
    """The dataclass ``kind`` from a TOML table with a key per field.

    Raises:
        RobotError: An unknown or missing key, or a value that is not of its field's type.
    """
    if not isinstance(values, Mapping):
        place.expected("a table", values)
    members = {member.name: member for member in fields(kind)}  # type: ignore[arg-type]
    refuse_unknown(values, members, place)
    hints = get_type_hints(kind, include_extras=True)
    found = {
        name: _read_field(hints[name], member, values, place) for name, member in members.items()
    }
    return kind(**{name: value for name, value in found.items() if value is not MISSING})


def read_value(kind: Any, value: object, place: Place) -> Any:
    """A TOML value as the type ``kind``: a number, text, flag, list, table or dataclass.

    Raises:
        RobotError: It is none; the message names the place and says what is expected.
    """
    if kind is Any:
        return value
    origin, arguments = get_origin(kind), get_args(kind)
    if origin is Annotated:
        read = read_value(arguments[0], value, place)
        for rule in arguments[1:]:
            if not rule.holds(read):
                place.expected(rule.expected, value)
        return read
    if origin in (Union, types.UnionType):  # TOML has no null: who means None leaves the key out
        return read_value(next(a for a in arguments if a is not type(None)), value, place)
    if origin is tuple:
        return _read_list(kind, arguments, value, place)
    if origin is not None and issubclass(origin, Mapping):
        if not isinstance(value, Mapping):
            place.expected("a table", value)
        return {key: read_value(arguments[1], item, place / key) for key, item in value.items()}
    if is_dataclass(kind) and isinstance(kind, type):
        return read_table(kind, value, place)
    return _read_scalar(kind, value, place)


def refuse_unknown(values: Iterable[str], known: Iterable[str], place: Place) -> None:
    """Raise for the first key of ``values`` that is not ``known``, with the nearest known one."""
    for key in values:
        if key not in known:
            (place / key).fail(f"unknown key; {nearest(key, known)}")


def nearest(name: str, known: Iterable[str]) -> str:
    """What to write instead of a name that is not known."""
    known = list(known)
    near = difflib.get_close_matches(name, known, n=1, cutoff=0.5)
    return f"did you mean {near[0]!r}?" if near else f"choose one of {', '.join(known)}"


def describe(kind: Any) -> str:
    """What a value of ``kind`` is, for a message."""
    origin, arguments = get_origin(kind), get_args(kind)
    if origin is Annotated:
        return arguments[1].expected if arguments[1:] else describe(arguments[0])
    if origin in (Union, types.UnionType):
        return describe(next(a for a in arguments if a is not type(None)))
    if origin is tuple and arguments[-1] is not Ellipsis:
        return f"a list of {len(arguments)} numbers"
    if origin is tuple:
        return "a list of names" if arguments[0] is str else "a list"
    return _NAMES.get(kind, "a table")


def shown_value(value: object) -> str:
    """A TOML value in a message: short, and as it is written in the file."""
    try:  # repr of a list that lies as deep as Python's stack fails, and of 5,000 digits
        text = str(value).lower() if isinstance(value, bool) else _SHORT.repr(value)
    except ValueError:
        return "a number of too many digits"
    return text if len(text) <= 60 else f"{text[:57]}..."


_SHORT = reprlib.Repr()
_SHORT.maxstring = _SHORT.maxother = 100
_SHORT.maxlist = _SHORT.maxdict = 20


_NAMES: dict[Any, str] = {
    float: "a number",
    int: "a whole number",
    bool: "true or false",
    str: "a text",
}


def _read_field(kind: Any, member: Field[Any], values: Mapping[str, Any], place: Place) -> Any:
    if member.name in values:
        return read_value(kind, values[member.name], place / member.name)
    if member.default is MISSING and member.default_factory is MISSING:
        (place / member.name).fail(f"missing; expected {describe(kind)}")
    return MISSING


def _read_list(kind: Any, arguments: tuple[Any, ...], value: object, place: Place) -> Any:
    if not isinstance(value, list):
        place.expected(describe(kind), value)
    if arguments[-1] is Ellipsis:
        return tuple(read_value(arguments[0], v, place / i) for i, v in enumerate(value))
    if len(value) != len(arguments):
        place.expected(describe(kind), value)
    pairs = zip(arguments, value, strict=True)
    return tuple(read_value(a, v, place / i) for i, (a, v) in enumerate(pairs))


def _finite(value: Any) -> bool:
    try:
        return math.isfinite(value)
    except OverflowError:  # a whole number that no float holds
        return False


def _read_scalar(kind: Any, value: object, place: Place) -> Any:
    number = isinstance(value, int | float) and not isinstance(value, bool)
    if kind is float and number and _finite(value):
        return float(value)  # type: ignore[arg-type]
    if kind is int and number and isinstance(value, int):
        return value
    if kind in (bool, str) and isinstance(value, kind):
        return value
    if kind is float and number:
        place.expected("a finite number", value)
    place.expected(_NAMES[kind], value)
