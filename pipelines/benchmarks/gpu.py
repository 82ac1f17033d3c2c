"""``lacoloco bench gpu``: parity first, then the metrics of one table, then trainings for as long
as there is time.

What is known is on disk after every row, so a run that is cut short has yielded all it had.
"""

from __future__ import annotations

import json
import os
import signal
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

from lacoloco.datasets.artifact import read_header
from lacoloco.datasets.atomic_write import write_file
from lacoloco.datasets.hardware import describe_machine
from lacoloco.datasets.provenance import git_commit, lacoloco_version, timestamp
from lacoloco.pipelines import train_low
from lacoloco.pipelines.benchmarks.throughput import BenchConfig, bench_sim, bench_train
from lacoloco.pipelines.chains import chain
from lacoloco.pipelines.sim.parity import check_parity
from lacoloco.pipelines.stage import StageContext
from lacoloco.robots.registry import load_robot

METRICS = "metrics.json"
METRICS_BEFORE = "figures.json"
"""Name of this file in earlier versions of lacoloco."""
PARITY_WORLDS = 256
TRAININGS = (
    ("solo12-synthetic", "drail-cat"),
    ("solo12-synthetic", "gan-cat"),
    ("solo12-synthetic", "drail"),
    ("solo12-synthetic", "gan"),
    ("solo12-dog", "drail-cat"),
    ("h1-synthetic", "drail-cat"),
)
"""What the remaining minutes are spent on, in this order."""


@dataclass(frozen=True)
class GpuBenchConfig:
    """How much is measured.

    Attributes:
        worlds: parallel worlds of the measurements.
        seconds: about so long per measurement.
        minutes: for trainings, after the measurements; 0 for none.
        preset: preset of the trainings.
    """

    worlds: int = 4096
    seconds: float = 10.0
    minutes: float = 0.0
    preset: str = "gpu"


@dataclass(frozen=True)
class Row:
    """One line of the table: what is measured, and the rates [control steps/s] that it must and
    should reach.
    """

    name: str
    measure: Callable[[], dict[str, Any]]
    must: float
    aim: float


def bench_gpu(
    config: GpuBenchConfig, context: StageContext, out: Path | None = None
) -> dict[str, Any]:
    """Check that the engines agree, measure, then train.

    Args:
        config: how much.
        context: device; the run's folder takes ``metrics.json``, runs named after it the trainings.
        out: a folder that takes copies, flat, of this file, the policies and the checkpoint of
            what was cut short.

    Returns:
        What ``metrics.json`` holds: machine, commit, command, ``parity``, ``rows`` and
        ``trainings``.

    Raises:
        StageError: the engines disagree, or the device has none.
    """
    report = Report(context, config, out)
    for robot in ("solo12", "h1"):
        context.progress.say(f"parity with the C engine: {robot}")
        found = check_parity(load_robot(robot), context.device, min(config.worlds, PARITY_WORLDS))
        report.add("parity", {"robot": robot, **found})
    for row in table(config, context.device):
        context.progress.say(f"measuring: {row.name}")
        metrics = row.measure()
        rate = metrics["steps_per_second"]
        report.add("rows", {"name": row.name, "must": row.must, "aim": row.aim, **metrics})
        context.progress.say(
            f"{row.name}: {rate:.0f} control steps/s (must {row.must:.0f}, aim {row.aim:.0f})"
        )
    if config.minutes > 0:
        _train_all(config, context, report)
    return report.content


def table(config: GpuBenchConfig, device: str) -> list[Row]:
    """The measurements, in order."""
    size = BenchConfig(
        worlds=config.worlds,
        steps=min(40, config.worlds),
        rounds=1000,
        seconds=config.seconds,
        recipe="gpu",
    )

    def training() -> dict[str, Any]:
        metrics = bench_train(size, robot="solo12", device=device)
        # Not measured, but what the rate amounts to.
        minutes = train_low.paper().samples / metrics["steps_per_second"] / 60.0
        return {**metrics, "paper_budget_minutes_at_this_rate": minutes}

    return [
        Row(
            "Solo12 env loop",
            partial(bench_sim, size, robot="solo12", device=device),
            400_000,
            1_000_000,
        ),
        Row("Solo12 ASE + DRAIL + CaT training", training, 200_000, 400_000),
        Row("H1 env loop", partial(bench_sim, size, robot="h1", device=device), 150_000, 400_000),
    ]


class Report:
    """The metrics so far, on disk after every addition."""

    def __init__(self, context: StageContext, config: GpuBenchConfig, out: Path | None) -> None:
        """Begin with the circumstances."""
        self._places = [
            folder for folder in (context.store.directory(context.run), out) if folder is not None
        ]
        self.out = out
        self.content: dict[str, Any] = {
            "begun": timestamp(),
            "lacoloco": lacoloco_version(),
            "commit": git_commit(),
            "command": context.command,
            "device": context.device,
            "machine": describe_machine(),
            "config": asdict(config),
            "parity": [],
            "rows": [],
            "trainings": [],
        }
        self._write()

    def add(self, part: str, row: dict[str, Any]) -> None:
        """Append a row to one part."""
        self.content[part].append(row)
        self._write()

    def keep(self, path: Path, name: str) -> None:
        """Copy a file to the folder for copies, if there is one."""
        if self.out is not None:
            write_file(self.out / name, path.read_bytes(), replace=True)

    def _write(self) -> None:
        for folder in self._places:
            write_file(folder / METRICS, json.dumps(self.content, indent=1).encode(), replace=True)


def _train_all(config: GpuBenchConfig, context: StageContext, report: Report) -> None:
    deadline = time.monotonic() + 60.0 * config.minutes
    for name, method in TRAININGS:
        remaining = deadline - time.monotonic()
        if remaining <= 0:
            return
        mine = replace(context, run=f"{context.run}-{name}", resume=True)
        row = {
            "experiment": name,
            "method": method,
            "preset": config.preset,
            "seed": context.seed,
            "run": mine.run,
        }
        begin = time.monotonic()
        try:
            with interrupted_after(remaining):
                row |= _train(name, method, mine, config.preset, report)
        except KeyboardInterrupt:
            if time.monotonic() < deadline:  # a person did it
                raise
            context.progress.stop()
            row |= {"status": "cut short"}
            _keep_checkpoints(mine, f"{name}-{method}", report)
        report.add("trainings", {**row, "wall_seconds": time.monotonic() - begin})


def _train(
    name: str, method: str, context: StageContext, preset: str, report: Report
) -> dict[str, Any]:
    """One experiment from nothing to its row of Table I; what is there already is kept."""
    context.progress.say(f"training: {name} {method}")
    chain.make_motions(name, context, preset=preset)
    high = chain.train_both(name, context, preset=preset, method=method)
    report.keep(high, f"{name}-{method}-seed{context.seed}.h5")
    header = read_header(high)
    low = read_header(header.parents[0].locate(high))
    evaluation = chain.evaluate(name, context, preset=preset, policies=[high])
    (row,) = read_header(evaluation.artifact).metadata["rows"]
    return {
        "status": "done",
        "low": low.metadata["metrics"],
        "high": header.metadata["metrics"],
        "evaluation": {key: value for key, value in row.items() if key != "policy"},
    }


def _keep_checkpoints(context: StageContext, label: str, report: Report) -> None:
    for stage in ("experts", "train-low", "train-high"):
        for unfinished in context.store.partials(context.run, stage)[-1:]:
            for checkpoint in unfinished.path.glob("*.checkpoint.h5"):
                report.keep(checkpoint, f"{label}-{stage}-{checkpoint.name}")


@contextmanager
def interrupted_after(seconds: float) -> Iterator[None]:
    """Interrupt the body as Ctrl-C would, once ``seconds`` have passed: a training then writes its
    checkpoint.
    """

    def interrupt(number: int, frame: object) -> None:
        if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:  # as in a shell's background jobs
            raise KeyboardInterrupt
        os.kill(os.getpid(), signal.SIGINT)

    previous = signal.signal(signal.SIGALRM, interrupt)
    signal.setitimer(signal.ITIMER_REAL, max(seconds, 1e-3))
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, previous)
