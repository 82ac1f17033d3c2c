"""The errors of this room: one line that names the file or key and what to do about it."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path


class DatasetError(ValueError):
    """A motion, a motion-capture file or a library that cannot be used as asked."""


class ArtifactError(DatasetError):
    """An artifact or a run directory that cannot be read, written or found."""


class ConfigError(DatasetError):
    """A config with a value that its field does not allow."""


@contextmanager
def storage_errors(path: Path | str, action: str) -> Iterator[None]:
    """Turn what the file system refuses below `path` into an `ArtifactError`.

    Args:
        path: file or directory that the message names.
        action: what was being done, as a verb phrase: "write", "create the run directory".

    Raises:
        ArtifactError: for every `OSError` inside the block (read-only, full, not a directory...).
    """
    try:
        yield
    except OSError as error:
        reason = (error.strerror or str(error) or type(error).__name__).lower()
        advice = "check its permissions"
        if action != "read":
            advice += " and the free space, or choose another place with LACOLOCO_RUNS"
        raise ArtifactError(f"{path}: cannot {action}: {reason}; {advice}") from error
