"""The loop over the iterations of a training."""

from __future__ import annotations

import signal
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from lacoloco.pipelines.learn import parallel
from lacoloco.pipelines.stage import StageContext
from lacoloco.pipelines.training.checkpoint import (
    checkpoint_path,
    restore_checkpoint,
    save_checkpoint,
)
from lacoloco.pipelines.training.diagnostics import Metrics
from lacoloco.pipelines.training.metrics_log import MetricsLog, NoLog
from lacoloco.pipelines.training.trainer import Trainer

CHECKPOINT_SECONDS = 60.0
"""Between two checkpoints [s]."""


def train(
    trainer: Trainer,
    iterations: int,
    directory: Path,
    context: StageContext,
    description: str,
    shown: tuple[str, ...] = (),
    config: dict[str, Any] | None = None,
    warn: Callable[[Sequence[Metrics]], list[str]] | None = None,
) -> dict[str, Any]:
    """Run the training to its end, from its checkpoint if there is one.

    Ctrl-C is taken at the end of the running iteration: the checkpoint then holds exactly that
    iteration. The last checkpoint stays until the version is complete, so that a finished
    training is not repeated by a resumed stage.

    Of several processes (``learn.parallel``) the first one logs and writes checkpoints; samples are
    those of all.

    Args:
        trainer: what to train.
        iterations: how many iterations in all.
        directory: where ``<description>.checkpoint.h5``, ``metrics.jsonl`` and TensorBoard events
            go.
        context: seed, progress and whether to resume.
        description: name of the training, unique in the directory.
        shown: the metrics to show while it runs.
        config: written into the checkpoint.
        warn: what is wrong, from the metrics of all iterations so far; each name is said once while
            it runs.

    Returns:
        The last iteration's metrics with ``samples``, ``seconds``, ``samples_per_second`` and the
        ``warnings`` that hold.

    Raises:
        KeyboardInterrupt: after the checkpoint was written.
    """
    checkpoint = checkpoint_path(directory, description)
    start, elapsed, metrics = restore_checkpoint(trainer, checkpoint, context.seed)
    parallel.wait_for_all()
    first = parallel.rank() == 0
    per_iteration = trainer.samples_per_iteration * parallel.size()
    total = iterations * per_iteration
    context.progress.start(description, total)
    if start:
        # Told at once, or the first pace and estimate would count what was done before.
        context.progress.advance(start * per_iteration)
    begin = saved = time.monotonic()
    log = MetricsLog(directory, description, start * per_iteration) if first else NoLog()
    watch = _Watch(warn, context)
    with log, _deferred_interrupt() as interrupted:
        for iteration in range(start, iterations):
            metrics = trainer.iterate(iteration / iterations)
            samples = (iteration + 1) * per_iteration
            log.write(samples, metrics)
            watch(log.history)
            context.progress.advance(
                samples, **{name: metrics[name] for name in shown if name in metrics}
            )
            now, stop = time.monotonic(), parallel.any_process(interrupted(), context.device)
            if first and (stop or now - saved > CHECKPOINT_SECONDS):
                save_checkpoint(
                    trainer,
                    checkpoint,
                    iteration + 1,
                    elapsed + now - begin,
                    metrics,
                    context,
                    config or {},
                )
                saved = now
            if stop:
                raise KeyboardInterrupt
        warnings = watch(log.history)
    context.progress.stop()
    seconds = elapsed + time.monotonic() - begin
    if first and start < iterations:
        # Whatever interrupts the rest of the stage, the training need not be repeated.
        save_checkpoint(trainer, checkpoint, iterations, seconds, metrics, context, config or {})
    speed = {"samples": total, "seconds": seconds, "samples_per_second": total / max(seconds, 1e-9)}
    return metrics | speed | {"warnings": warnings}


class _Watch:
    """Says each warning once, when it is first seen; the text before its colon is its name."""

    def __init__(
        self, warn: Callable[[Sequence[Metrics]], list[str]] | None, context: StageContext
    ) -> None:
        self._warn, self._progress, self._said = warn, context.progress, set[str]()

    def __call__(self, history: Sequence[Metrics]) -> list[str]:
        warnings = self._warn(history) if self._warn is not None else []
        for line in warnings:
            name = line.partition(":")[0]
            if name not in self._said:
                self._progress.say(f"WARNING: {line}")
            self._said.add(name)
        return warnings


@contextmanager
def _deferred_interrupt() -> Iterator[Callable[[], bool]]:
    """Turn the first Ctrl-C into a flag; the second one acts at once. Only the main thread can."""
    seen: list[int] = []

    def note(number: int, frame: object) -> None:
        if seen:
            raise KeyboardInterrupt
        seen.append(number)

    try:
        previous = signal.signal(signal.SIGINT, note)
    except ValueError:
        yield lambda: False
        return
    try:
        yield lambda: bool(seen)
    finally:
        signal.signal(signal.SIGINT, previous)
