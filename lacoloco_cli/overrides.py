"""`--set path.to.field=value`: typed changes to a tree of frozen dataclasses."""

from __future__ import annotations

import dataclasses
import difflib
import types
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, Literal, TypeVar, Union, get_args, get_origin, get_type_hints

from lacoloco_cli.failures import UserError

Config = TypeVar("Config")

_YES = {"true", "yes", "on", "1"}
_NO = {"false", "no", "off", "0"}
_NONE = {"none", "null"}


class OverrideError(UserError):
    """A `--set` that names an unknown key or gives a value of the wrong type."""


def apply_overrides(config: Config, assignments: Sequence[str]) -> Config:
    """Return a copy of a config with some fields replaced.

    Args:
        config: A dataclass whose fields may be dataclasses themselves. It is not changed.
        assignments: `"path.to.field=value"`, applied in order. Values are read by the field's
            annotation: int (also `3e6`), float, bool, str, Path, Literal, Optional (`none`),
            and tuples (`1,2,3`).

    Raises:
        OverrideError: Malformed, unknown key (the nearest is named), wrong type, or a value that
            the field does not allow.
    """
    from lacoloco.datasets.config_values import check_config
    from lacoloco.datasets.errors import ConfigError

    for assignment in assignments:
        path, equals, text = assignment.partition("=")
        keys = [key.strip() for key in path.split(".")]
        if not equals or not all(keys):
            raise OverrideError(f"--set {assignment}: write it as path.to.field=value")
        config = _replaced(config, keys, text.strip(), root=config, path=".".join(keys))
    try:  # after all of them: what fits together may take two
        check_config(config)
    except ConfigError as error:
        raise OverrideError(f"--set {error}") from error
    return config


def restored(template: Config, stored: Mapping[str, Any], where: str = "config") -> Config:
    """Make a config again from what an artifact keeps of it (JSON: tuples are lists there).

    Args:
        template: A config of the same type; its values stand for fields not stored.
        stored: `Header.config`, of this version or an earlier one.
        where: How a message names the whole.

    Raises:
        ArtifactError: A stored field is not known, has a value that it does not allow, or is an
            option that was removed and is in use.
    """
    from lacoloco.datasets.config_values import check_config
    from lacoloco.datasets.errors import ArtifactError, ConfigError

    config = _restored(template, stored, where)
    try:
        check_config(config)
    except ConfigError as error:
        raise ArtifactError(f"{where}: {error}; made by another version of lacoloco") from error
    return config


def _restored(template: Config, stored: Mapping[str, Any], where: str) -> Config:
    from lacoloco.datasets.errors import ArtifactError
    from lacoloco.datasets.old_names import translated

    schema = type(template).__name__
    try:
        stored = translated(schema, stored)
    except ArtifactError as error:
        raise ArtifactError(f"{where}: {error}") from error
    fields = {field.name for field in dataclasses.fields(template)}  # type: ignore[arg-type]
    if unknown := sorted(set(stored) - fields):
        raise ArtifactError(
            f"{where}: {schema} has no field {', '.join(map(repr, unknown))}; made by another "
            "version of lacoloco"
        )
    changes = {}
    for name, value in stored.items():
        old = getattr(template, name)
        nested = dataclasses.is_dataclass(old) and isinstance(value, Mapping)
        changes[name] = _restored(old, value, f"{where}.{name}") if nested else _tuples(value)
    return dataclasses.replace(template, **changes)  # type: ignore[type-var]


def _tuples(value: Any) -> Any:
    return tuple(_tuples(item) for item in value) if isinstance(value, list) else value


def field_paths(config: Any) -> Iterator[str]:
    """Yield the dotted path of every field that `--set` can change."""
    for field in dataclasses.fields(config):
        value = getattr(config, field.name)
        if dataclasses.is_dataclass(value):
            yield from (f"{field.name}.{rest}" for rest in field_paths(value))
        else:
            yield field.name


def _replaced(config: Any, keys: list[str], text: str, root: Any, path: str) -> Any:
    name, *rest = keys
    if name not in {field.name for field in dataclasses.fields(config)}:
        raise OverrideError(_unknown(config, name, root, path))
    old = getattr(config, name)
    if rest and not dataclasses.is_dataclass(old):
        raise OverrideError(f"--set {path}: {name!r} is a value and has no field {rest[0]!r}")
    if rest:
        new = _replaced(old, rest, text, root, path)
    elif dataclasses.is_dataclass(old):
        inner = ", ".join(f"{path}.{key}" for key in field_paths(old))
        raise OverrideError(f"--set {path}: is a group of fields; set one of {inner}")
    else:
        new = _parsed(text, get_type_hints(type(config))[name], path)
    try:
        return dataclasses.replace(config, **{name: new})
    except OverrideError:
        raise
    except ValueError as error:  # the config's own check of its values
        raise OverrideError(f"--set {path}={text}: {error}") from error


def _unknown(config: Any, name: str, root: Any, path: str) -> str:
    """Name the nearest key: by whole path first, then by the field's own name anywhere."""
    paths = list(field_paths(root))
    near = difflib.get_close_matches(path, paths, n=1, cutoff=0.75)
    if not near:
        last = path.rsplit(".", 1)[-1]
        by_name = {candidate.rsplit(".", 1)[-1]: candidate for candidate in reversed(paths)}
        near = [by_name[key] for key in difflib.get_close_matches(last, by_name, n=1)]
    here = ", ".join(field.name for field in dataclasses.fields(config))
    hint = f"did you mean {near[0]!r}? " if near else ""
    return f"--set {path}: no key {name!r}; {hint}keys here: {here}"


def _parsed(text: str, hint: Any, path: str) -> Any:
    """Read a value by its annotation."""
    origin = get_origin(hint)
    if origin in (Union, types.UnionType):
        return _parsed_union(text, hint, path)
    if origin is Literal:
        choices = {str(choice): choice for choice in get_args(hint)}
        if text not in choices:
            raise _wrong(path, text, f"one of {', '.join(choices)}")
        return choices[text]
    if origin is tuple:
        return _parsed_tuple(text, get_args(hint), path)
    if hint is bool:
        if text.lower() not in _YES | _NO:
            raise _wrong(path, text, "true or false")
        return text.lower() in _YES
    if hint in (int, float):
        return _parsed_number(text, hint, path)
    if hint in (str, Path):
        return hint(text)
    raise OverrideError(f"--set {path}: a field of type {_name(hint)} cannot be set here")


def _parsed_union(text: str, hint: Any, path: str) -> Any:
    arms = get_args(hint)
    if type(None) in arms and text.lower() in _NONE:
        return None
    # str takes any text, so it is asked last
    for arm in sorted((arm for arm in arms if arm is not type(None)), key=lambda arm: arm is str):
        try:
            return _parsed(text, arm, path)
        except OverrideError:
            continue
    raise _wrong(path, text, _name(hint))


def _parsed_tuple(text: str, items: tuple[Any, ...], path: str) -> tuple[Any, ...]:
    parts = _split(text)
    if len(items) == 2 and items[1] is Ellipsis:
        return tuple(_parsed(part, items[0], path) for part in parts)
    if len(parts) != len(items):
        raise _wrong(path, text, f"{len(items)} values separated by commas")
    return tuple(_parsed(part, item, path) for part, item in zip(parts, items, strict=True))


def _split(text: str) -> list[str]:
    """Split at the commas outside of brackets; one pair around everything is left out."""
    parts, depth, wrapped = [""], 0, text[:1] in ("(", "[") and text[-1:] in (")", "]")
    for index, letter in enumerate(text):
        depth += (letter in "([") - (letter in ")]")
        wrapped = wrapped and (depth > 0 or index == len(text) - 1)
        if letter == "," and depth == 0:
            parts.append("")
        else:
            parts[-1] += letter
    if wrapped:
        return _split(text[1:-1])
    return [part.strip() for part in parts if part.strip()]


def _parsed_number(text: str, kind: type, path: str) -> int | float:
    try:
        if kind is int and text.lstrip("+-").replace("_", "").isdigit():
            return int(text)  # not through float, which has 53 bits
        number = float(text)
        if number != number:
            raise ValueError("not a number")
        if kind is int and number != int(number):
            raise ValueError("not a whole number")
    except (ValueError, OverflowError) as error:
        raise _wrong(path, text, kind.__name__) from error
    return kind(number)


def _wrong(path: str, text: str, expected: str) -> OverrideError:
    return OverrideError(f"--set {path}: expected {expected}, got {text!r}")


def _name(hint: Any) -> str:
    return hint.__name__ if isinstance(hint, type) else str(hint).replace("typing.", "")
