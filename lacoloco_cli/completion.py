"""What the tab key completes beside verbs and options: the values that can be listed.

What an option or argument takes follows from its name and its metavar. Where nothing is listed, the
shell completes names of files.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable
from typing import Any

PRESETS = ("smoke", "laptop", "gpu", "paper", "paper-method")
PUBLISHED = ("--policy", "--low", "--motions")
"""Options that take a published artifact, too."""


def complete_values(command: Any) -> None:
    """Let the shell complete the values of a command's options and arguments."""
    for parameter in command.params:
        known = values_of(parameter)
        if known is not None:
            parameter._custom_shell_complete = _completer(known)


def values_of(parameter: Any) -> Callable[[], Iterable[str]] | None:
    """What lists the values of an option or argument; None where they cannot be listed."""
    metavar, names = (parameter.metavar or "").strip("[]."), set(parameter.opts)
    if "--preset" in names:
        return lambda: PRESETS
    if metavar == "NAME|PATH":
        return _robots
    if metavar == "RUN" or "--run" in names:
        return _runs
    if metavar in ("RUN|PATH", "ARTIFACT", "LOW", "POLICY"):
        return lambda: (*_runs(), *_published())
    if names & set(PUBLISHED):
        return _published
    words = [] if "[" in metavar else metavar.split("|")
    literal = [word for word in words if re.fullmatch(r"[a-z][a-z0-9-]*", word)]
    return (lambda: literal) if literal else None


def _completer(known: Callable[[], Iterable[str]]) -> Callable[..., list[Any]]:
    def complete(context: Any, parameter: Any, incomplete: str) -> list[str]:
        try:
            return [value for value in known() if value.startswith(incomplete)]
        except Exception:  # a folder that cannot be read; an error has no place at a prompt
            return []

    return complete


def _robots() -> Iterable[str]:
    from lacoloco.robots.registry import robot_names

    return robot_names()


def _runs() -> Iterable[str]:
    from lacoloco.datasets.store import RunStore

    return RunStore().runs()


def _published() -> Iterable[str]:
    from lacoloco.datasets.published import names

    return names()
