"""What every training shares: the loop over iterations, its log, its checkpoints and its end."""

from __future__ import annotations

import json
import signal
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, nullcontext
from pathlib import Path
from typing import Any, Protocol

import torch

from lacoloco.datasets.artifact import read_artifact, write_artifact
from lacoloco.datasets.atomic_write import write_file
from lacoloco.datasets.state import flatten_state, unflatten_state
from lacoloco.datasets.store import StageDir
from lacoloco.pipelines.learn import parallel
from lacoloco.pipelines.stage import StageContext
from lacoloco.pipelines.training.diagnostics import Metrics

CHECKPOINT = "lacoloco/checkpoint"
CHECKPOINT_SECONDS = 60.0
INDIVIDUAL = ("env", "latent", "latents", "restarts", "exploring", "generator")
"""Parts of a trainer's state that every process of a training has for itself: its worlds and its
generators.
"""


class Trainer(Protocol):
    """One training, an iteration at a time. Its state must make the next iteration what it would
    have been.
    """

    samples_per_iteration: int

    def iterate(self, progress: float) -> dict[str, float]:
        """Collect a rollout and learn from it; ``progress`` in [0, 1) is the share of the training
        already done.
        """

    def state_dict(self) -> dict[str, Any]:
        """Networks, optimisers, environment, generators."""

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Restore :meth:`state_dict`."""


def describe(stage: str, method: str, seed: int) -> str:
    """What the training of one method and seed is called, in its log and while it runs."""
    return f"{stage} {method} seed {seed}"


def begin(context: StageContext, stage: str, method: str) -> StageDir:
    """Open a training's working directory, with the checkpoint to go on from if there is one.

    Of several processes the first one does so, the others only learn its name.

    Raises:
        ArtifactError: the directory cannot be opened, or another process is at work in it.
    """
    opened, label = None, f"{method}-seed{context.seed}"
    if parallel.rank() == 0:
        opened = context.store.begin(context.run, stage, resume=context.resume, label=label)
        place = checkpoint_path(opened.path, describe(stage, method, context.seed))
        if context.checkpoint is not None and not place.exists():
            write_file(place, context.checkpoint.read_bytes())
    path, final = parallel.from_first(opened and (opened.path, opened.final))
    return opened or StageDir(path, final, label)


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
    iteration. The last checkpoint stays until :func:`remove_checkpoints`, so that a finished
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
    start, elapsed, metrics = _restore(trainer, checkpoint, context.seed)
    parallel.wait_for_all()
    first = parallel.rank() == 0
    per_iteration = trainer.samples_per_iteration * parallel.size()
    total = iterations * per_iteration
    context.progress.start(description, total)
    begin = saved = time.monotonic()
    log = MetricsLog(directory, description, start * per_iteration) if first else _NoLog()
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
                _save(
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
        _save(trainer, checkpoint, iterations, seconds, metrics, context, config or {})
    speed = {"samples": total, "seconds": seconds, "samples_per_second": total / max(seconds, 1e-9)}
    return metrics | speed | {"warnings": warnings}


def checkpoint_path(directory: Path, description: str) -> Path:
    """Where a training's checkpoint lies in its stage's directory."""
    return directory / f"{description.replace(' ', '-')}.checkpoint.h5"


def has_checkpoint(directory: Path) -> bool:
    """Whether a training in a stage's directory got as far as its first checkpoint."""
    return any(directory.glob("*.checkpoint.h5"))


def remove_checkpoints(directory: Path) -> None:
    """Delete the checkpoints in a stage's directory, once its artifact holds what they were for."""
    for path in directory.glob("*.checkpoint.h5"):
        path.unlink()


class MetricsLog:
    """``metrics.jsonl`` and TensorBoard events of one training, appended to when it resumes."""

    def __init__(self, directory: Path, name: str, done: int = 0) -> None:
        """Open both in ``directory``; ``name`` prefixes the TensorBoard tags.

        Lines of this training beyond ``done`` samples are dropped: a killed one wrote them after
        its last checkpoint.
        """
        from torch.utils.tensorboard import SummaryWriter

        self.name = name
        path = directory / "metrics.jsonl"
        lines = path.read_text().splitlines(keepends=True) if path.exists() else []
        kept = [line for line in lines if not self._is_repeated(line, done)]
        path.write_text("".join(kept))
        self.history: list[Metrics] = [
            one for one in map(json.loads, kept) if one["training"] == name
        ]
        """The metrics of all iterations of this training so far, also of those before it was
        resumed.
        """
        self._lines = path.open("a")
        self._events = SummaryWriter(str(directory / "tensorboard"), purge_step=done + 1)

    def _is_repeated(self, line: str, done: int) -> bool:
        try:
            logged = json.loads(line)
        except json.JSONDecodeError:  # cut short by the kill
            return True
        return logged["training"] == self.name and logged["samples"] > done

    def __enter__(self) -> MetricsLog:
        """Use as a context manager."""
        return self

    def __exit__(self, *_: object) -> None:
        """Close both."""
        self._lines.close()
        self._events.close()

    def write(self, samples: int, metrics: dict[str, float]) -> None:
        """Log one iteration's metrics at ``samples`` control steps."""
        self.history.append({"training": self.name, "samples": samples, **metrics})
        self._lines.write(json.dumps(self.history[-1]) + "\n")
        self._lines.flush()
        for name, value in metrics.items():
            self._events.add_scalar(f"{self.name}/{name}", value, samples)


class _NoLog(nullcontext):
    """What the other processes of a training write."""

    history: Sequence[Metrics] = ()

    def write(self, samples: int, metrics: dict[str, float]) -> None:
        """Nothing."""


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


def _save(
    trainer: Trainer,
    path: Path,
    iteration: int,
    elapsed: float,
    metrics: dict[str, float],
    context: StageContext,
    config: dict[str, Any],
) -> None:
    state = {
        "trainer": trainer.state_dict(),
        "torch_rng": torch.get_rng_state(),
        "metrics": metrics,
    }
    if context.device.startswith("cuda"):
        state["cuda_rng"] = torch.cuda.get_rng_state()
    arrays, structure = flatten_state(state)
    metadata = {
        "structure": structure,
        "iteration": iteration,
        "elapsed_s": elapsed,
        "processes": parallel.size(),
    }
    write_artifact(
        path,
        CHECKPOINT,
        arrays,
        metadata=metadata,
        config=config,
        seed=context.seed,
        robot=None,
        command=context.command,
        replace=True,
    )


def _restore(trainer: Trainer, path: Path, seed: int) -> tuple[int, float, dict[str, float]]:
    if not path.exists():
        return 0, 0.0, {}
    artifact = read_artifact(path, CHECKPOINT)
    state = unflatten_state(artifact.arrays, artifact.metadata["structure"])
    iteration = int(artifact.metadata["iteration"])
    if parallel.rank() == 0 and artifact.metadata.get("processes", 1) == parallel.size():
        trainer.load_state_dict(state["trainer"])
        torch.set_rng_state(state["torch_rng"])
        if "cuda_rng" in state and torch.cuda.is_available():
            torch.cuda.set_rng_state(state["cuda_rng"])
    else:
        # The file holds the first process's worlds: the others go on with new ones, or they would
        # do the same again. So does the first one when there are more or fewer processes now, and
        # its share is another.
        trainer.load_state_dict(_with_own(state["trainer"], trainer.state_dict()))
        torch.manual_seed(parallel.own_seed(seed) + iteration)
    return iteration, float(artifact.metadata["elapsed_s"]), state["metrics"]


def _with_own(loaded: dict[str, Any], own: dict[str, Any]) -> dict[str, Any]:
    """``loaded`` with what is individual taken from ``own``, at every depth."""
    merged = dict(loaded)
    for name, value in loaded.items():
        if name in INDIVIDUAL:
            merged[name] = own[name]
        elif isinstance(value, dict) and isinstance(own.get(name), dict):
            merged[name] = _with_own(value, own[name])
    return merged


@contextmanager
def _deferred_interrupt() -> Iterator:
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
