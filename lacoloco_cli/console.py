"""What a person sees: progress on stderr, tables on stdout."""

from __future__ import annotations

import sys
import time
from collections import deque
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import typer

if TYPE_CHECKING:
    import rich.live
    import rich.table

    from lacoloco.pipelines.stage import Progress

Clock = Callable[[], float]
READABLE = 110
"""Width of a wrapped table."""
ROUNDED_OFF = 1e-9
"""A number below is what rounding has left of zero."""


def note(line: str) -> None:
    """Print one line on stderr."""
    typer.echo(line, err=True)


def progress(quiet: bool = False) -> Progress:
    """Choose how progress is shown: not at all, as a bar (terminal) or as plain lines."""
    if quiet:
        from lacoloco.pipelines.stage import SILENT

        return SILENT
    return Bar() if sys.stderr.isatty() else Lines()


class Meter:
    """Rate of work over a sliding window."""

    WINDOW = 60.0  # s; long enough to smooth an update, short enough to follow a change
    RESUMED = 0.5  # s; a jump this soon after the start is work done before, not now

    def __init__(self, total: int, clock: Clock = time.monotonic) -> None:
        """Start at zero done."""
        self.total = total
        self.done = 0
        self._clock = clock
        self._samples = deque([(clock(), 0)])
        self._fresh = True

    def update(self, done: int) -> None:
        """Record how much is done, absolute."""
        now = self._clock()
        if self._fresh and now - self._samples[0][0] < self.RESUMED:
            self._samples.clear()
        self._fresh = False
        self._samples.append((now, done))
        while len(self._samples) > 2 and now - self._samples[0][0] > self.WINDOW:
            self._samples.popleft()
        self.done = done

    @property
    def rate(self) -> float:
        """Work per second; 0 while unknown."""
        (start, first), (end, last) = self._samples[0], self._samples[-1]
        return (last - first) / (end - start) if end > start else 0.0

    def summary(self) -> str:
        """Done of total, share, rate and time left, for one line."""
        parts = [f"{self.done:,}"]
        if self.total:
            parts = [f"{self.done:,}/{self.total:,}", f"({self.done / self.total:.0%})"]
        if self.rate:
            parts.append(f"{rate_text(self.rate)}/s")
            if self.total:
                parts.append(f"eta {duration_text((self.total - self.done) / self.rate)}")
        return " ".join(parts)


class Lines:
    """Progress as plain lines, one every ten seconds at most: for logs and pipes."""

    EVERY = 10.0  # s

    def __init__(self, clock: Clock = time.monotonic) -> None:
        """Print nothing yet."""
        self._clock = clock
        self._meter: Meter | None = None
        self._metrics: Mapping[str, float] = {}
        self._description = ""
        self._printed_at = 0.0
        self._printed: int | None = None

    def start(self, description: str, total: int) -> None:
        """Begin a part; the first line comes with the first metrics."""
        self._meter = Meter(total, self._clock)
        self._description = description
        self._metrics = {}
        self._printed_at, self._printed = self._clock(), None

    def advance(self, done: int, **metrics: float) -> None:
        """Take note, and print when ten seconds have passed since the last line."""
        if self._meter is None:
            return
        self._meter.update(done)
        self._metrics = {**self._metrics, **metrics}
        if self._clock() - self._printed_at >= self.EVERY:
            self._print()

    def say(self, line: str) -> None:
        """Print a line."""
        note(line)

    def stop(self) -> None:
        """End the part with a last line."""
        if self._meter is not None and self._printed != self._meter.done:
            self._print()
        self._meter = None

    def _print(self) -> None:
        assert self._meter is not None
        self._printed_at, self._printed = self._clock(), self._meter.done
        metrics = metrics_text(self._metrics)
        note(f"{self._description}  {self._meter.summary()}  {metrics}".rstrip())


class Bar:
    """Progress as one live bar per part, with rate and time left, and the metrics below it."""

    def __init__(self) -> None:
        """Draw nothing yet."""
        self._live: rich.live.Live | None = None
        self._meter: Meter | None = None
        self._metrics: Mapping[str, float] = {}

    def start(self, description: str, total: int) -> None:
        """Begin a part with its own bar."""
        from rich.console import Console, Group
        from rich.live import Live
        from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn
        from rich.text import Text

        self.stop()
        self._meter, self._metrics = Meter(total), {}
        bar = BarColumn(bar_width=16)
        columns = ("{task.description}", bar, "{task.fields[summary]}", TimeElapsedColumn())
        # the columns are drawn by the Live below, which knows where the metrics go
        self._bar = Progress(*(TextColumn(c) if isinstance(c, str) else c for c in columns))
        self._bar.add_task(description, total=total or None, summary="")
        self._text = Text(style="dim", no_wrap=True, overflow="ellipsis")
        console = Console(stderr=True)
        self._live = Live(Group(self._bar, self._text), console=console, refresh_per_second=4)
        self._live.start()

    def advance(self, done: int, **metrics: float) -> None:
        """Move the bar."""
        if self._live is None or self._meter is None:
            return
        self._meter.update(done)
        self._metrics = {**self._metrics, **metrics}
        summary = self._meter.summary()
        self._bar.update(self._bar.task_ids[0], completed=done, summary=summary)
        self._text.plain = metrics_text(self._metrics)

    def say(self, line: str) -> None:
        """Print a line above the bar."""
        if self._live is None:
            note(line)
        else:
            self._live.console.print(line, markup=False, highlight=False)

    def stop(self) -> None:
        """Freeze the bar where it is."""
        if self._live is not None:
            self._bar.stop_task(self._bar.task_ids[0])
            self._live.stop()
        self._live = self._meter = None


def print_table(
    columns: Sequence[str], rows: Iterable[Sequence[Any]], *, title: str | None = None
) -> None:
    """Print a table on stdout; numbers to the right, everything else to the left.

    In a terminal that is too narrow for it, columns become lines: a row folded in every cell is not
    read by anybody.
    """
    from rich.console import Console

    rows = [list(row) for row in rows]
    console = Console(markup=False, highlight=False)
    if not console.is_terminal:
        console.width = 1000  # a pipe has no edge to wrap at
    table = _table(columns, rows, title)
    if rows and len(columns) > 2 and table_width(columns, rows) > console.width:
        for row in rows:
            lines = [[column, cell_text(cell)] for column, cell in zip(columns, row, strict=True)]
            console.print(_table(("", ""), lines, title, headings=False))
            title = None
            console.print()
        return
    console.print(table)


def table_width(columns: Sequence[str], rows: Sequence[Sequence[Any]]) -> int:
    """Letters in a line of a table that is not wrapped; two are between columns."""
    cells = [[column, *(cell_text(row[i]) for row in rows)] for i, column in enumerate(columns)]
    return sum(max(map(len, column)) for column in cells) + 2 * (len(columns) - 1)


def _table(
    columns: Sequence[str],
    rows: Sequence[Sequence[Any]],
    title: str | None,
    *,
    headings: bool = True,
) -> rich.table.Table:
    from rich.table import Table

    table = Table(title=title, title_justify="left", box=None, pad_edge=False, show_header=headings)
    for index, column in enumerate(columns):
        numeric = bool(rows) and all(_is_number(row[index]) for row in rows)
        table.add_column(column, justify="right" if numeric else "left", overflow="fold")
    for row in rows:
        table.add_row(*(cell_text(cell) for cell in row))
    return table


def print_wrapped(columns: Mapping[str, int | None], rows: Iterable[Sequence[str]]) -> None:
    """Print a table of texts on stdout, in a narrow terminal narrower than ``READABLE``.

    Args:
        columns: Heading -> most characters in a line; None takes what the others leave.
        rows: A text per column; what is too long goes on in the next line.
    """
    from rich.console import Console
    from rich.table import Table

    table = Table(box=None, pad_edge=False)
    for column, width in columns.items():
        table.add_column(column, overflow="fold", max_width=width)
    for row in rows:
        table.add_row(*row)
    console = Console(markup=False, highlight=False)
    console.width = min(console.width, READABLE) if console.is_terminal else READABLE
    console.print(table)


def cell_text(value: Any) -> str:
    """Write one value the way a person reads it."""
    if value is None:
        return "-"
    if isinstance(value, float):
        if abs(value) < ROUNDED_OFF:
            return "0"
        return f"{value:.4g}" if abs(value) < 1e4 else f"{value:,.0f}"
    if isinstance(value, int) and not isinstance(value, bool):
        return f"{value:,}" if abs(value) >= 10_000 else str(value)
    return str(value)


def metrics_text(metrics: Mapping[str, float]) -> str:
    """Write named metrics one after another."""
    return "  ".join(f"{name} {cell_text(value)}" for name, value in metrics.items())


def rate_text(rate: float) -> str:
    """Write a rate with at most four digits."""
    return f"{rate / 1000:.1f}k" if rate >= 1000 else f"{rate:.3g}"


def duration_text(seconds: float) -> str:
    """Write a duration as `42s`, `3m05s` or `2h07m`."""
    whole = int(seconds + 0.5)
    if whole < 60:
        return f"{whole}s"
    if whole < 3600:
        return f"{whole // 60}m{whole % 60:02d}s"
    return f"{whole // 3600}h{whole % 3600 // 60:02d}m"


def _is_number(value: Any) -> bool:
    return value is None or (isinstance(value, (int, float)) and not isinstance(value, bool))
