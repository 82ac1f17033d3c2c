"""`--resume` needs no other argument: what was typed the first time is kept with the run."""

from __future__ import annotations

import json
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import typer

if TYPE_CHECKING:
    from pathlib import Path

    from lacoloco.datasets.store import RunStore


def remember(store: RunStore, run: str, verb: str, arguments: Sequence[str]) -> None:
    """Keep the arguments of a verb (without its name) for a later `--resume`.

    Raises:
        ArtifactError: The run directory cannot be written.
    """
    from lacoloco.datasets.atomic_write import write_file

    write_file(_place(store, run, verb), json.dumps(list(arguments)).encode(), replace=True)


def recall(store: RunStore, run: str, verb: str) -> list[str]:
    """Arguments of the verb's last call in the run; none when nothing readable is kept."""
    try:
        arguments = json.loads(_place(store, run, verb).read_text())
    except (OSError, ValueError):
        return []
    return [str(argument) for argument in arguments] if isinstance(arguments, list) else []


def fill_in(context: typer.Context, arguments: Sequence[str]) -> dict[str, Any]:
    """Values of the options that were typed then (`arguments`) and are not typed now.

    Args:
        context: The call with `--resume`.
        arguments: From `recall`.
    """
    before = context.command.make_context(context.info_name, list(arguments), context.parent)
    return {
        name: value
        for name, value in before.params.items()
        if _typed(before, name) and not _typed(context, name)
    }


def _typed(context: Any, name: str) -> bool:
    source = context.get_parameter_source(name)
    return source is not None and source.name == "COMMANDLINE"


def _place(store: RunStore, run: str, verb: str) -> Path:
    return store.directory(run) / f".{verb}.arguments.json"
