"""Where the command begins: Ctrl-C ends it in one line even while Python still imports."""

from __future__ import annotations

import sys
from typing import NoReturn

INTERRUPTED = 130


def run() -> NoReturn:
    """Import the front door and open it."""
    try:
        from lacoloco_cli.main import app

        app()
        sys.exit(0)
    except KeyboardInterrupt:
        print("interrupted", file=sys.stderr)  # noqa: T201
        sys.exit(INTERRUPTED)
