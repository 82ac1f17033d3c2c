"""What train-low and train-high have in common: open, pretrain, train, save, clean up."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Protocol, TypeVar

from lacoloco.datasets.atomic_write import write_file
from lacoloco.datasets.store import ARTIFACT, StageDir
from lacoloco.datasets.work import Work
from lacoloco.pipelines.learn import parallel
from lacoloco.pipelines.stage import StageContext, StageResult
from lacoloco.pipelines.training.checkpoint import TRAINING, checkpoint_path, part_of
from lacoloco.pipelines.training.diagnostics import Metrics
from lacoloco.pipelines.training.loop import train
from lacoloco.pipelines.training.pretraining import KeptPretraining, PretrainingLog
from lacoloco.pipelines.training.trainer import Trainer


class StageTrainer(Trainer, Protocol):
    """A trainer that knows how long it trains and may be pretrained."""

    @property
    def iterations(self) -> int:
        """Iterations in all."""

    def pretrain(self, log: PretrainingLog | None = None) -> Mapping[str, float]:
        """Fit the first policy without rewards, and tell ``log`` how far that is; returns what is
        worth saying of the policy.
        """


AnyTrainer = TypeVar("AnyTrainer", bound=StageTrainer)


@dataclass(frozen=True)
class TrainStage:
    """One training as a stage.

    Attributes:
        verb: Name of the stage.
        method: What is trained, in the artifact and in the name of its folder.
        config: Stored with checkpoints and artifact.
        context: Seed, store, progress.
        work: What it is made from; a resumed training has the same.
        log_keys: Metrics shown while it runs.
        warn: Warnings, from the metrics of all iterations so far.
    """

    verb: str
    method: str
    config: Any
    context: StageContext
    work: Work
    log_keys: tuple[str, ...]
    warn: Callable[[Sequence[Metrics]], list[str]]

    def run(
        self,
        make_trainer: Callable[[], AnyTrainer],
        save: Callable[[AnyTrainer, Path, dict[str, Any]], dict[str, Any]],
        pretraining: str | None,
    ) -> StageResult:
        """Train to the end, also from a checkpoint, and save.

        Args:
            make_trainer: Builds the trainer, once the stage's directory is open.
            save: ``save(trainer, path, metrics)`` writes the artifact and returns its metrics. Only
                the first of several processes calls it.
            pretraining: What to say before the pretraining; None: no pretraining.

        Raises:
            ArtifactError: The directory cannot be opened, or another process is at work in it.
        """
        directory = begin(self.context, self.verb, self.method, self.work)
        trainer = make_trainer()
        name = describe(self.verb, self.method, self.context.seed)
        path = checkpoint_path(directory.path, name)
        # A training without a checkpoint starts again, its pretraining after the last round.
        if pretraining and part_of(path) != TRAINING:
            self.context.progress.say(pretraining)
            log = KeptPretraining(self.context, path, asdict(self.config))
            if reached := trainer.pretrain(log):
                said = (f"{key} {value:.3g}" for key, value in reached.items())
                self.context.progress.say(", ".join(said))
        metrics = train(
            trainer,
            trainer.iterations,
            directory.path,
            self.context,
            name,
            self.log_keys,
            config=asdict(self.config),
            warn=self.warn,
        )
        if parallel.rank():
            return self._result(directory.final / ARTIFACT, metrics)
        metrics = save(trainer, directory.file(ARTIFACT), metrics)
        return self._result(directory.complete(), metrics)

    def _result(self, path: Path, metrics: dict[str, Any]) -> StageResult:
        return StageResult(path, {"method": self.method, "seed": self.context.seed, **metrics})


def describe(stage: str, method: str, seed: int) -> str:
    """What the training of one method and seed is called, in its log and while it runs."""
    return f"{stage} {method} seed {seed}"


def begin(context: StageContext, stage: str, method: str, work: Work) -> StageDir:
    """Open a training's working directory, with the checkpoint to go on from if there is one.

    Of several processes the first one does so, the others only learn its name.

    Raises:
        ArtifactError: the directory cannot be opened, or another process is at work in it.
    """
    opened, label = None, f"{method}-seed{context.seed}"
    if parallel.rank() == 0:
        opened = context.begin(stage, work, label)
        place = checkpoint_path(opened.path, describe(stage, method, context.seed))
        if context.checkpoint is not None and not place.exists():
            write_file(place, context.checkpoint.read_bytes())
    path, final = parallel.from_first(opened and (opened.path, opened.final))
    return opened or StageDir(path, final, label)
