"""From an exception to the one line and the exit code a person sees."""

from __future__ import annotations

import typer

USER_MISTAKE = 2
OUR_BUG = 1
INTERRUPTED = 130


class UserError(ValueError):
    """A mistake on the command line; the message is one line and says what to do."""


def explain(error: BaseException) -> tuple[str, int]:
    """Turn an exception into one line and an exit code.

    Returns:
        The line (without `error: `) and 2 for the user's mistakes (files, keys, options) or 1
        for a bug of ours.
    """
    if isinstance(error, typer.TyperException):
        return one_line(error.format_message()), USER_MISTAKE
    if isinstance(error, _user_errors()):
        return one_line(str(error)), USER_MISTAKE
    what = one_line(f"{type(error).__name__}: {error}")
    return f"{what} (a bug in lacoloco; run again with --debug for the traceback)", OUR_BUG


def one_line(text: str) -> str:
    """Join the lines of a message, so that one error is one line."""
    return " ".join(text.split())


def _user_errors() -> tuple[type[BaseException], ...]:
    """The rooms' own errors; imported late because `lacoloco --help` needs none of them."""
    from lacoloco.datasets.errors import DatasetError
    from lacoloco.pipelines.errors import StageError
    from lacoloco.robots.errors import RobotError

    return (UserError, DatasetError, StageError, RobotError)
