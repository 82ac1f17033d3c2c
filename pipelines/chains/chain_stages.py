"""One experiment's stages, run in order or kept where they are done."""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from importlib import import_module
from pathlib import Path
from typing import Any

from lacoloco.datasets.config_values import check_config
from lacoloco.datasets.store import StageDir
from lacoloco.datasets.work import Work, in_one_line
from lacoloco.pipelines.chains.experiments import INPUT_OF, STAGES, Experiment
from lacoloco.pipelines.chains.stage_configs import Settings, changed, config_of
from lacoloco.pipelines.chains.summaries import summarise
from lacoloco.pipelines.errors import StageError
from lacoloco.pipelines.robot import belongs_to
from lacoloco.pipelines.stage import StageContext, StageResult
from lacoloco.robots.registry import load_robot
from lacoloco.robots.spec import RobotSpec

TRAININGS = ("train-low", "train-high")
ALWAYS_RUN = ("retarget", "eval", "export", "play")
"""Stages that are quick, or that take over by themselves what is there."""


@dataclass(frozen=True)
class Outcome:
    """One stage of a chain: how long it took [s], what came out in one line, and where it is."""

    stage: str
    seconds: float
    summary: str
    artifact: Path


class ChainStages:
    """Runs one experiment's stages in order, feeding each the newest artifacts of those before
    it.
    """

    def __init__(
        self,
        experiment: Experiment,
        context: StageContext,
        preset: str,
        method: str,
        mocap: list[Path],
        settings: Settings,
    ) -> None:
        """For one run, preset and method; ``mocap`` replaces the bundled sample."""
        self.experiment, self.context = experiment, context
        self.preset, self.method = preset, method
        self.mocap, self.settings = mocap, settings
        self._made: dict[str, Path] = {}

    def run(self, seeds: range, published: Path | None = None) -> Iterator[Outcome]:
        """All stages in order; with a ``published`` low level, only what comes after it."""
        motion_stages = () if published is not None else self.experiment.motion_stages
        for verb in motion_stages:
            yield self.stage(verb, self.context, **self.sources(verb))
        policies = []
        for seed in seeds:
            context, low = replace(self.context, seed=seed), published
            if low is None:
                motions = [self.newest(verb) for verb in self.experiment.learn_from]
                trained = self.stage("train-low", context, motions=motions)
                yield trained
                low = trained.artifact
            high = self.stage("train-high", context, low=low)
            policies.append(high.artifact)
            yield high
        evaluation = self.stage("eval", self.context, policies=policies)
        yield evaluation
        best = self._best(evaluation.artifact, policies)
        yield self.stage("export", self.context, policy=best)
        for source in (*(self.newest(verb) for verb in motion_stages), best):
            yield self.stage("play", self.context, source=source)

    def sources(self, verb: str) -> dict[str, Any]:
        """What a stage that makes motions takes."""
        if verb in INPUT_OF:
            return {"motions": [self.newest(INPUT_OF[verb])]}
        mocap = {"sources": self.mocap} if verb == "retarget" and self.mocap else {}
        return {"robot": self.experiment.robot, **mocap}

    def stage(self, verb: str, context: StageContext, **inputs: Any) -> Outcome:
        """Run one stage; with ``context.resume``, keep it where the same work is complete, and go
        on where it is not.
        """
        module = import_module(f"lacoloco.pipelines.{STAGES[verb]}")
        begin = time.monotonic()
        done = self.done(verb, context, **inputs) if context.resume else None
        if done is not None:
            self._made[verb] = done
            return Outcome(verb, 0.0, "kept", done)
        result: StageResult = module.run(self.config(verb), context, **inputs)
        self._made[verb] = result.artifact
        return Outcome(
            verb, time.monotonic() - begin, summarise(verb, result.metrics), result.artifact
        )

    def done(self, verb: str, context: StageContext, **inputs: Any) -> Path | None:
        """The newest complete version with the same work; what differs in the others is said."""
        from lacoloco.datasets.artifact import read_header

        if verb in ALWAYS_RUN:
            return None
        asked: Work | None = None
        said = ""
        for path in reversed(self.context.store.all(self.context.run, verb)):
            header = read_header(path)
            if verb in TRAININGS and (
                header.seed != context.seed or header.metadata.get("method") != self.method
            ):
                continue
            module = import_module(f"lacoloco.pipelines.{STAGES[verb]}")
            asked = asked or module.work(self.config(verb), context, **inputs)
            differences = Work.of(header).differences(asked)
            if not differences:
                return path
            said = said or f"{verb} {path.parent.name} is not kept: {in_one_line(differences)}"
        if said:
            context.progress.say(f"{said}; running it again as a new version")
        return None

    def unfinished(self, verb: str, context: StageContext, **inputs: Any) -> tuple[StageDir, ...]:
        """The unfinished versions of a training with the same work."""
        module = import_module(f"lacoloco.pipelines.{STAGES[verb]}")
        asked = module.work(self.config(verb), context, **inputs)
        label = f"{self.method}-seed{context.seed}"
        found = self.context.store.partials(self.context.run, verb, label)
        begun = ((one, Work.read(one.path)) for one in found)
        return tuple(one for one, work in begun if work and not work.differences(asked))

    def config(self, verb: str) -> Any:
        """A stage's config: the preset's, then the experiment's, then the settings'."""
        config = config_of(self.experiment, verb, preset=self.preset, method=self.method)
        config = changed(config, self.settings.get(verb, {}))
        check_config(config, f"{verb}.")
        return config

    @cached_property
    def robot(self) -> RobotSpec:
        """The experiment's robot."""
        return load_robot(self.experiment.robot)

    def newest(self, verb: str) -> Path:
        """What this chain made in a stage, else the run's newest artifact of the robot.

        Raises:
            StageError: the run has none of this robot.
            ArtifactError: the run has none at all.
        """
        from lacoloco.datasets.artifact import read_header

        if verb in self._made:
            return self._made[verb]
        store, run = self.context.store, self.context.run
        for path in reversed(store.all(run, verb)):
            if belongs_to(read_header(path), self.robot):
                return path
        raise StageError(
            f"{store.newest(run, verb)}: not of robot '{self.robot.name}' as it is now; make"
            f" others with `lacoloco {verb}`, or name another run"
        )

    def _best(self, evaluation: Path, policies: list[Path]) -> Path:
        from lacoloco.datasets.artifact import read_header

        best = read_header(evaluation).metadata["best"]["policy"]
        return next(path for path in policies if str(path) == best)
