"""From an exception to the one line and the exit code a person sees."""

from __future__ import annotations

import errno
import os
import traceback

import typer

USER_MISTAKE = 2
OUR_BUG = 1
INTERRUPTED = 130

REFUSED = {
    errno.ENAMETOOLONG: "use a shorter name or path",
    errno.ELOOP: "its links lead in a circle",
    errno.ENOTDIR: "a part of the path is a file",
    errno.ENOSPC: "make room, then give the command again",
    errno.EDQUOT: "make room, then give the command again",
    errno.EFBIG: "allow larger files, then give the command again",
    **dict.fromkeys((errno.EACCES, errno.EPERM, errno.EROFS), "check the permissions"),
    **dict.fromkeys((errno.EMFILE, errno.ENFILE), "allow more open files (ulimit -n)"),
    **dict.fromkeys((errno.EIO, errno.ESTALE), "check the disk"),
    errno.ENOMEM: "free memory, or ask for less",
}
"""What the system may refuse to any program -> what to do. A missing file is not among them: ours
are looked for before they are opened.
"""


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
    if told := _of_the_system(error):
        return one_line(told), USER_MISTAKE
    what = one_line(f"{type(error).__name__}: {error}")
    return f"{what} (a bug in lacoloco; run again with --debug for the traceback)", OUR_BUG


def one_line(text: str) -> str:
    """Join the lines of a message, so that one error is one line."""
    return " ".join(text.split())


def _of_the_system(error: BaseException) -> str:
    """What the system, and not lacoloco, is to blame for; "" for anything else."""
    if isinstance(error, OSError) and error.errno in REFUSED:
        # Some libraries leave out which file it was.
        file = f"{error.filename}: " if error.filename is not None else ""
        return f"{file}{os.strerror(error.errno).lower()}; {REFUSED[error.errno]}"
    asked = os.environ.get("MUJOCO_GL")
    if asked and any(_chooses_gl(frame) for frame in traceback.extract_tb(error.__traceback__)):
        return f"MUJOCO_GL={asked}: does not work here; use egl, osmesa or glfw, or unset it"
    return ""


def _chooses_gl(frame: traceback.FrameSummary) -> bool:
    """Whether a line is of the part of MuJoCo that loads the OpenGL asked for when imported."""
    parts = frame.filename.split(os.sep)
    chooses = parts[-1] == "gl_context.py" or parts[-2:-1] in (["egl"], ["osmesa"], ["glfw"])
    return "mujoco" in parts and chooses and frame.name == "<module>"


def _user_errors() -> tuple[type[BaseException], ...]:
    """The rooms' own errors; imported late because `lacoloco --help` needs none of them."""
    from lacoloco.datasets.errors import DatasetError
    from lacoloco.pipelines.errors import StageError
    from lacoloco.robots.errors import RobotError

    return (UserError, DatasetError, StageError, RobotError)
