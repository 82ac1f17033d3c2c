"""Which part of a recording is used: `START:END` in frames of the file, or in seconds."""

from __future__ import annotations

import re

from lacoloco.datasets.errors import DatasetError
from lacoloco.datasets.mocap import Mocap
from lacoloco.pipelines.errors import StageError

_SIDE = r"(\d+(?:\.\d+)?s|\d+)?"
_FORM = re.compile(f"{_SIDE}:{_SIDE}")


def check_trim(text: str) -> None:
    """Refuse what is no trim.

    Raises:
        StageError: Neither empty nor START:END.
    """
    if text and not _FORM.fullmatch(text):
        raise StageError(
            f"--trim {text}: use START:END, in frames (120:600) or in seconds (2s:10s); either may"
            " be left out"
        )


def trimmed(mocap: Mocap, text: str) -> Mocap:
    """The part of a recording that a trim means.

    Whole numbers are frames of the file, numbers that end in s are seconds from its start; the
    first frame is part of it, the last is not; an end beyond the recording is its end.

    Args:
        mocap: At the rate of its file.
        text: See above; "" for all of it.

    Raises:
        StageError: It is no trim.
        DatasetError: Nothing is left.
    """
    start, stop = trim_range(text, mocap.frames, mocap.fps)
    if start >= stop:
        raise DatasetError(
            f"{mocap.name}: nothing is left of {mocap.frames} frames"
            f" ({mocap.frames / mocap.fps:.2f} s) by trim {text}"
        )
    return mocap.slice(start, stop) if text else mocap


def trim_range(text: str, frames: int, fps: float) -> tuple[int, int]:
    """First frame of a trim, and the frame after its last, of a file with so many frames.

    Raises:
        StageError: It is no trim.
    """
    check_trim(text)
    start, stop = (_frame(side, fps) for side in (text or ":").split(":"))
    return start or 0, min(frames if stop is None else stop, frames)


def _frame(text: str, fps: float) -> int | None:
    if not text:
        return None
    return round(float(text[:-1]) * fps) if text.endswith("s") else int(text)
