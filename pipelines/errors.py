"""What a stage raises when its inputs, not its code, are at fault."""

from __future__ import annotations


class StageError(RuntimeError):
    """A stage cannot do its work with what it was given.

    The message is one line that names the file or the key and says what to do; the command line
    prints it as it is and exits with code 2.
    """
