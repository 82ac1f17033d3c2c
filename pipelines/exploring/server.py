"""Where the live page is served: on this machine alone."""

from __future__ import annotations

import socket
from collections.abc import Iterator
from contextlib import contextmanager, redirect_stdout
from importlib.util import find_spec
from io import StringIO
from typing import TYPE_CHECKING

from lacoloco.pipelines.errors import StageError

if TYPE_CHECKING:
    import viser

HOST = "127.0.0.1"


def check_viser() -> None:
    """Refuse, before the work, where the live page cannot be made.

    Raises:
        StageError: viser is not installed.
    """
    if find_spec("viser") is None:
        raise StageError("explore needs viser; pip install 'lacoloco[explore]'")


@contextmanager
def local_server(port: int = 0, label: str = "lacoloco") -> Iterator[viser.ViserServer]:
    """A server that nothing outside this machine reaches.

    viser can ask a public service for a tunnel when a page tells it to; this one does not.

    Args:
        port: 0: any that is free.
        label: Title of the panel.

    Raises:
        StageError: The port is not to be had.
    """
    import viser

    class LocalServer(viser.ViserServer):
        def request_share_url(self, verbose: bool = True) -> str | None:
            """Open no way in from outside."""
            return None

    with redirect_stdout(StringIO()):  # it prints its address whatever `verbose` says
        server = LocalServer(HOST, check_port(port), label, verbose=False)
    try:
        server.gui.configure_theme(show_logo=False, show_share_button=False, control_width="large")
        server.gui.main_panel.dock_right()
        yield server
    finally:
        with redirect_stdout(StringIO()):
            server.stop()


def check_port(port: int) -> int:
    """The port, if it is free: viser itself would silently take the next one. One that is free for
    0.

    Raises:
        StageError: It is not.
    """
    try:
        with socket.socket() as trial:
            trial.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            trial.bind((HOST, port))
            return int(trial.getsockname()[1])
    except OSError as error:
        raise StageError(f"--port {port}: {error.strerror}; use another one, or 0") from error
