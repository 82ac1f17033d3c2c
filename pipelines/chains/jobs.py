"""Work in jobs of its own, on this machine or on a cluster: as many at a time as wanted, and none
stops the others.

On `submitit <https://github.com/facebookincubator/submitit>`_, an optional dependency. The pickles
by which it hands over a call are deleted with the job's end; its output stays. What a job did is
seen in what it left.
"""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from lacoloco.datasets.hardware import cores
from lacoloco.pipelines.errors import StageError

EXECUTORS = ("local", "slurm")
TIMEOUT_MIN = 24 * 60
"""Minutes after which a job is ended; ``--slurm time=MINUTES`` gives others. A training then goes
on when asked again.
"""


@dataclass(frozen=True)
class Ended:
    """How one job ended.

    Attributes:
        name: the job's.
        seconds: from its submission to its end.
        error: the last line of what went wrong; empty when nothing did.
        log: folder and prefix of its output.
    """

    name: str
    seconds: float
    error: str
    log: str


def make_executor(kind: str, folder: Path, options: Mapping[str, Any] | None = None) -> Any:
    """An executor of submitit that keeps its files in ``folder``, which all machines must see.

    Args:
        kind: ``local`` or ``slurm``.
        folder: made when it is new.
        options: parameters of Slurm, e.g. ``{"partition": "gpu", "gpus_per_node": "1"}``.

    Raises:
        StageError: an unknown kind, submitit or Slurm is missing, or an option means nothing to
            submitit.
    """
    if kind not in EXECUTORS:
        raise StageError(f"--executor {kind}: use {' or '.join(EXECUTORS)}")
    try:
        import submitit
    except ModuleNotFoundError as error:
        raise StageError(
            "--executor: submitit is missing; pip install 'lacoloco[cluster]'"
        ) from error
    try:
        executor = submitit.AutoExecutor(folder=folder, cluster=kind)
        executor.update_parameters(timeout_min=TIMEOUT_MIN)
        executor.update_parameters(
            **{f"slurm_{name}": value for name, value in (options or {}).items()}
        )
    except (RuntimeError, NameError, ValueError) as error:
        raise StageError(f"--executor {kind}: {' '.join(str(error).split())}") from error
    return executor


def run_jobs(
    executor: Any,
    work: Callable[..., None],
    jobs: Mapping[str, Sequence[Any]],
    *,
    at_once: int,
    poll_s: float = 1.0,
) -> Iterator[Ended]:
    """Call ``work(*arguments)`` once per job, and tell how each ended as soon as it has.

    Jobs on this machine share its cores out: two that use all of them take longer together than one
    after the other.

    Args:
        executor: from :func:`make_executor`.
        work: importable by name; its arguments must be plain.
        jobs: name -> arguments.
        at_once: at most so many are submitted and not yet ended.
        poll_s: seconds between two looks.

    Raises:
        StageError: a job is not accepted.
    """
    waiting = list(jobs)
    running: dict[str, tuple[float, Any]] = {}
    shared = min(at_once, len(waiting)) if getattr(executor, "cluster", "") == "local" else 1
    try:
        while waiting or running:
            while waiting and len(running) < at_once:
                name = waiting.pop(0)
                with _share_of_cores(shared):
                    running[name] = (time.monotonic(), _submit(executor, work, jobs[name]))
            time.sleep(poll_s)
            for name, (begin, job) in list(running.items()):
                if job.done():
                    del running[name]
                    ended = Ended(
                        name,
                        time.monotonic() - begin,
                        _error(job),
                        str(job.paths.folder / job.job_id),
                    )
                    _forget(job)
                    yield ended
    finally:
        # Ctrl-C asks for an end of it; what the jobs did so far is in their
        # checkpoints.
        for _, job in running.values():
            job.cancel()
            _forget(job)


@contextmanager
def _share_of_cores(jobs: int) -> Iterator[None]:
    """Processes started in here take one of ``jobs`` equal parts of the cores, unless the user has
    said how many.
    """
    told = os.environ.get("OMP_NUM_THREADS")
    if told is None and jobs > 1:
        os.environ["OMP_NUM_THREADS"] = str(max(1, cores() // jobs))
    try:
        yield
    finally:
        if told is None:
            os.environ.pop("OMP_NUM_THREADS", None)


def _submit(executor: Any, work: Callable[..., None], arguments: Sequence[Any]) -> Any:
    try:
        return executor.submit(work, *arguments)
    except Exception as error:  # whatever the cluster's own commands have against it
        reason = " ".join(str(error).split())
        raise StageError(f"the job was not accepted: {reason}; see --slurm") from error


def _forget(job: Any) -> None:
    for pickled in (job.paths.submitted_pickle, job.paths.result_pickle):
        pickled.unlink(missing_ok=True)


def _error(job: Any) -> str:
    """The last line that a job left about its failure; empty for none."""
    try:
        error = job.exception()
    except Exception as lost:  # a job that was killed leaves no result to read
        error = lost
    lines = [line for line in str(error or "").splitlines() if line.strip()]
    if error is None:
        return ""
    told = _last_line(job.stderr())
    return told or (lines[-1].strip() if lines else type(error).__name__)


def _last_line(text: str | None) -> str:
    """What a process said last before it ended, submitit's own remarks left out."""
    lines = [line.strip() for line in (text or "").splitlines() if line.strip()]
    lines = [line for line in lines if not line.startswith(("submitit", "srun", "slurmstepd"))]
    return lines[-1] if lines else ""
