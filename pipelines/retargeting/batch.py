"""Many files at once: one after another in this process, or spread over several."""

from __future__ import annotations

import os
import signal
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future, ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from multiprocessing import get_context
from pathlib import Path

from lacoloco.datasets.errors import DatasetError
from lacoloco.pipelines.errors import StageError
from lacoloco.pipelines.retargeting.config import RetargetConfig
from lacoloco.pipelines.retargeting.worker import Program, Task, Worker
from lacoloco.pipelines.stage import Progress

Told = Callable[[int], None]
"""Told how many frames are done."""

_worker: Worker | None = None
"""Of a process of the pool."""


def processes(jobs: int, tasks: int) -> int:
    """How many processes to use.

    Args:
        jobs: What was asked for; 0 for the number of cores.
        tasks: Number of files.
    """
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count()
    return max(min(jobs or cores or 1, tasks), 1)


def retarget_all(
    worker: Worker,
    config: RetargetConfig,
    robot: str,
    tasks: Sequence[Task],
    folder: Path,
    jobs: int,
    progress: Progress,
) -> Iterator[tuple[Task, list[str] | DatasetError | StageError]]:
    """Retarget files; their clips and pictures go to `folder`.

    Args:
        worker: Of this process.
        config: How.
        robot: Name of the robot.
        tasks: The files.
        folder: Of the version.
        jobs: Number of processes, 0 for that of the cores.
        progress: Told frames of each file, or how many files are done.

    Yields:
        Each file as it is done, with what was found or what is wrong with it.

    Raises:
        StageError: A process died.
    """
    count = processes(jobs, len(tasks))
    if count == 1:
        yield from _in_turn(worker, tasks, folder, progress)
        return
    # Forks of a process that holds threads of torch or BLAS may hang.
    pool = ProcessPoolExecutor(count, get_context("spawn"), _begin, (config, robot, worker.program))
    try:
        progress.start(f"retarget ({count} processes)", len(tasks))
        running: dict[Future[list[str]], Task] = {
            pool.submit(_work, task, folder): task for task in tasks
        }
        for done, future in enumerate(as_completed(running), 1):
            task = running[future]
            try:
                outcome: list[str] | DatasetError | StageError = future.result()
            except (DatasetError, StageError) as error:
                outcome = error
            progress.advance(done)
            yield task, outcome
    except BrokenProcessPool as error:
        raise StageError(
            "a retargeting process died, perhaps for lack of memory; what is finished is kept:"
            " the same command does the rest, --jobs 1 with less memory"
        ) from error
    finally:
        progress.stop()
        pool.shutdown(wait=False, cancel_futures=True)


def _in_turn(
    worker: Worker, tasks: Sequence[Task], folder: Path, progress: Progress
) -> Iterator[tuple[Task, list[str] | DatasetError | StageError]]:
    for number, task in enumerate(tasks, 1):
        which = f" ({number} of {len(tasks)})" if len(tasks) > 1 else ""

        def begin(frames: int, title: str = f"retarget {task.name}{which}") -> Told:
            progress.start(title, frames)
            return progress.advance

        try:
            outcome = worker.work(task, folder, begin)["notes"]
        except (DatasetError, StageError) as error:
            outcome = error
        finally:
            progress.stop()
        yield task, outcome


def _begin(config: RetargetConfig, robot: str, program: Program) -> None:
    """Start a process of the pool; Ctrl-C ends it at once and without a word."""
    global _worker
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    _worker = Worker(config, robot, program)


def _work(task: Task, folder: Path) -> list[str]:
    assert _worker is not None
    return _worker.work(task, folder, lambda frames: lambda done: None)["notes"]
