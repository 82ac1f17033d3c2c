"""What a pretraining tells while it runs, and what it goes on from."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

from lacoloco.pipelines.learn import parallel
from lacoloco.pipelines.stage import SILENT, Progress, StageContext
from lacoloco.pipelines.training.checkpoint import (
    PRETRAINING,
    restore_checkpoint,
    save_checkpoint,
)
from lacoloco.pipelines.training.trainer import Stateful


class PretrainingLog:
    """Progress of a pretraining in steps, and a checkpoint after each of its rounds.

    This one shows and keeps nothing: for pretrainings outside of a stage.
    """

    def __init__(self, progress: Progress = SILENT) -> None:
        """Tell the progress; keep nothing."""
        self._progress, self._done = progress, 0

    def start(self, description: str, total: int) -> None:
        """Begin, with so many steps in all."""
        self._done = 0
        self._progress.start(description, total)

    def advance(self, steps: int, **metrics: float) -> None:
        """Tell that so many further steps are done."""
        self._done += steps
        self._progress.advance(self._done, **metrics)

    def fitting(self, number: int) -> Callable[[int, float], None]:
        """What to call with further steps and the loss, in the round of that number."""
        return lambda steps, loss: self.advance(steps, round=number, loss=loss)

    def stop(self) -> None:
        """End."""
        self._progress.stop()

    def rounds(self, state: Stateful, count: int) -> Iterator[int]:
        """The numbers, from 1, of the rounds that are left of ``count``; what they have to go on
        from is in ``state``.
        """
        yield from range(1, count + 1)


class KeptPretraining(PretrainingLog):
    """The same, of a stage: with checkpoints."""

    def __init__(self, context: StageContext, path: Path, config: dict[str, Any]) -> None:
        """Keep the rounds at ``path``, where the training's own checkpoint will be."""
        super().__init__(context.progress)
        self._context, self._path, self._config = context, path, config

    def rounds(self, state: Stateful, count: int) -> Iterator[int]:
        """The numbers, from 1, of the rounds that are left of ``count``.

        Raises:
            ArtifactError: The checkpoint is damaged, or of another version.
        """
        finished, _, told = restore_checkpoint(state, self._path, self._context.seed, PRETRAINING)
        parallel.wait_for_all()  # or the first process replaces what others still read
        if finished:
            self._progress.say(f"going on after round {finished} of {count}")
            self.advance(int(told["steps"]))
        for number in range(finished + 1, count + 1):
            yield number
            if parallel.rank() == 0:
                self._save(state, number)

    def _save(self, state: Stateful, finished: int) -> None:
        told = {"steps": float(self._done)}
        context, config = self._context, self._config
        save_checkpoint(state, self._path, finished, 0.0, told, context, config, PRETRAINING)
