import inspect
from dataclasses import dataclass
from typing import Annotated

import typer

from lacoloco_cli.option_group import with_options


@dataclass(frozen=True)
class Colours:
    first: Annotated[str | None, typer.Option("--first")] = None
    second: Annotated[int, typer.Option("--second")] = 2


def paint(session, options: Colours, wall: str = "north"):
    session.append((options, wall))


def test_fields_become_parameters_where_the_options_were():
    parameters = inspect.signature(with_options(Colours)(paint)).parameters
    assert list(parameters) == ["session", "first", "second", "wall"]
    assert parameters["second"].default == 2


def test_the_verb_gets_one_object():
    calls = []
    with_options(Colours)(paint)(calls, first="red", wall="south")
    assert calls == [(Colours("red", 2), "south")]
