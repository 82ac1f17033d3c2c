"""Options of a verb as the fields of a dataclass, so that the verb takes one object."""

from __future__ import annotations

import functools
import inspect
from collections.abc import Callable
from dataclasses import fields
from typing import Any, get_type_hints

from lacoloco_cli.session import Session

Body = Callable[..., None]


def with_options(group: type[Any]) -> Callable[[Body], Body]:
    """Give a verb's function `(session, options, own options...)` the fields of a group.

    Args:
        group: A dataclass. Each field has a default, and an annotation that typer reads. The
            parameter `options` of the function is filled with an instance of it.

    Returns:
        A decorator. The decorated function takes every field as a keyword of its own.
    """
    hints = get_type_hints(group, include_extras=True)
    names = [field.name for field in fields(group)]
    options = [
        inspect.Parameter(
            field.name,
            inspect.Parameter.KEYWORD_ONLY,
            default=field.default,
            annotation=hints[field.name],
        )
        for field in fields(group)
    ]

    def decorate(body: Body) -> Body:
        @functools.wraps(body)
        def flat(session: Session, **values: Any) -> None:
            given = {name: values.pop(name) for name in names if name in values}
            body(session, options=group(**given), **values)

        signature = inspect.signature(body, eval_str=True)
        own: list[inspect.Parameter] = []
        for parameter in signature.parameters.values():
            own += options if parameter.name == "options" else [parameter]
        flat.__signature__ = signature.replace(  # type: ignore[attr-defined]
            parameters=[own[0], *(p.replace(kind=inspect.Parameter.KEYWORD_ONLY) for p in own[1:])]
        )
        return flat

    return decorate
