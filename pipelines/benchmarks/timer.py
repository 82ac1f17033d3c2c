"""Where the time goes: seconds by part of a program, each moment counted once."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any


class Stopwatch:
    """Sums of seconds by part. A part inside another one stops the outer one's clock while it
    runs.
    """

    def __init__(
        self,
        wait: Callable[[], None] = lambda: None,
        clock: Callable[[], float] = time.perf_counter,
    ) -> None:
        """Start with nothing.

        Args:
            wait: called before the clock is read, to let a GPU finish what was asked of it.
            clock: seconds.
        """
        self.seconds: dict[str, float] = {}
        self._wait, self._clock = wait, clock
        self._running: list[str] = []
        self._since = 0.0

    @contextmanager
    def part(self, name: str) -> Iterator[None]:
        """Count the time of the body under ``name``."""
        self._turn()
        self._running.append(name)
        try:
            yield
        finally:
            self._turn()
            self._running.pop()

    def watch(self, owner: object, method: str, name: str) -> None:
        """Count every call of ``owner.method`` under ``name`` from now on; only this one object is
        changed.
        """
        original = getattr(owner, method)

        def timed(*arguments: Any, **options: Any) -> Any:
            with self.part(name):
                return original(*arguments, **options)

        setattr(owner, method, timed)

    def shares(self) -> dict[str, float]:
        """Share of the total by part, largest first."""
        total = sum(self.seconds.values())
        ordered = sorted(self.seconds.items(), key=lambda item: -item[1])
        return {name: seconds / max(total, 1e-12) for name, seconds in ordered}

    def _turn(self) -> None:
        """Credit the time since the last turn to the innermost part."""
        self._wait()
        now = self._clock()
        if self._running:
            name = self._running[-1]
            self.seconds[name] = self.seconds.get(name, 0.0) + now - self._since
        self._since = now
