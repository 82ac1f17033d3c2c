"""`--resume` needs no other argument: what was typed the first time is kept with the work."""

from __future__ import annotations

import json
import re
import shlex
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import typer
import typer.core

from lacoloco_cli.failures import UserError

if TYPE_CHECKING:
    from pathlib import Path

    from lacoloco.datasets.store import RunStore, StageDir


class Resumable(typer.core.TyperCommand):
    """A command whose `--resume` may be followed by the number of a version."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Read `--resume 3` and `--resume=3` as `--resume --version-to-resume 3`."""
        read: list[str] = []
        for argument in args:
            flag, equals, version = argument.partition("=")
            if flag == "--resume" and equals:
                read += ["--resume", "--version-to-resume", version]
            elif read[-1:] == ["--resume"] and argument.isdecimal():
                read += ["--version-to-resume", argument]
            else:
                read.append(argument)
        return super().parse_args(ctx, read)


def unfinished_version(
    store: RunStore, run: str, verb: str, version: str, seed: int | None
) -> StageDir | None:
    """The version that `--resume` goes on with; None where nothing is unfinished.

    Args:
        store: All runs.
        run: Name of the run.
        verb: Whose version.
        version: Its number as typed, "" for the newest.
        seed: The newest with this seed, where there is one.

    Raises:
        UserError: The version that was asked for is not unfinished.
    """
    from lacoloco.datasets.work import Work

    found = store.partials(run, verb)
    if version:
        number = f"{int(version):04d}" if version.isdecimal() else version
        for one in found:
            if one.final.name == number:
                return one
        there = ", ".join(f"{one.final.name} {one.label}".strip() for one in found) or "none"
        raise UserError(
            f"--resume {version}: run '{run}' has no such unfinished version of {verb};"
            f" unfinished: {there}"
        )
    works = [(one, Work.read(one.path)) for one in found]
    same_seed = [one for one, work in works if seed is not None and work and work.seed == seed]
    chosen = same_seed or found
    return chosen[-1] if chosen else None


def arguments_of(command: str, verb: str, place: Path) -> list[str]:
    """The arguments of the verb in a command line that began a version, without its name.

    Raises:
        UserError: Another verb began it.
    """
    words = shlex.split(command)[1:]
    if words and words[0] != verb:
        run = f" --run {place.parents[1].name}"
        raise UserError(
            f"{place}: was begun by `lacoloco {words[0]}`; continue with `lacoloco {words[0]}{run}"
            " --resume`"
        )
    return words[1:]


def remember(store: RunStore, run: str, verb: str, arguments: Sequence[str]) -> None:
    """Keep the arguments of a verb that is no stage (without its name) for a later `--resume`.

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
        arguments: From `arguments_of` or `recall`.
    """
    before = context.command.make_context(context.info_name, list(arguments), context.parent)
    return {
        name: value
        for name, value in before.params.items()
        if typed(before, name) and not typed(context, name)
    }


def typed(context: Any, name: str) -> bool:
    """Whether an option stands on the command line."""
    source = context.get_parameter_source(name)
    return source is not None and source.name == "COMMANDLINE"


def without_resume(arguments: Sequence[str]) -> list[str]:
    """Arguments without `--resume` and its version, as a new version is begun with them."""
    kept: list[str] = []
    skipped = False
    for argument in arguments:
        if re.fullmatch(r"--resume(=.*)?", argument):
            skipped = argument == "--resume"
            continue
        if not (skipped and argument.isdecimal()):
            kept.append(argument)
        skipped = False
    return kept


def _place(store: RunStore, run: str, verb: str) -> Path:
    return store.directory(run) / f".{verb}.arguments.json"
