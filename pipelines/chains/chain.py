"""The chains of stages, quickstart and the paper's experiments: the only place where stages
meet.
"""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from importlib import import_module
from pathlib import Path
from typing import Any

from lacoloco.datasets.config_values import check_config
from lacoloco.datasets.work import Work, in_one_line
from lacoloco.pipelines.chains.experiments import (
    EXPERIMENTS,
    INPUT_OF,
    METHODS,
    STAGES,
    Experiment,
    known,
)
from lacoloco.pipelines.chains.summaries import summarise
from lacoloco.pipelines.errors import StageError
from lacoloco.pipelines.robot import belongs_to
from lacoloco.pipelines.stage import StageContext, StageResult
from lacoloco.robots.registry import load_robot
from lacoloco.robots.spec import RobotSpec

Settings = Mapping[str, Mapping[str, Any]]
"""Verb -> dotted path of a field of its config -> value."""

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


def run(
    name: str,
    context: StageContext,
    *,
    preset: str = "laptop",
    method: str = "drail-cat",
    seeds: int = 1,
    mocap: Sequence[Path] = (),
    robot: str | None = None,
    from_scratch: bool = False,
    settings: Settings | None = None,
) -> list[Outcome]:
    """Run an experiment from nothing to an evaluated, exported and rendered policy.

    Where the experiment may start from a published low level of this method, and there is one, only
    a new high level is trained: skills once, tasks in minutes.

    With ``context.resume``, a stage that is complete in this run is kept, and an unfinished one
    goes on, where it was begun with the same config, seed, robot and inputs. Any other runs again,
    as a new version; one line says what differs.

    Args:
        name: a key of ``EXPERIMENTS``.
        context: run, first seed, device.
        preset: preset of every stage.
        method: a key of ``METHODS``.
        seeds: trainings, from ``context.seed`` upwards; the best one is exported and played.
        mocap: files to retarget instead of the bundled sample; they need the whole chain.
        robot: another robot than the experiment's, by name or by the path of its folder; it needs
            the whole chain, too.
        from_scratch: run the whole chain even where a published low level would do.
        settings: fields of the stages' configs that are neither the preset's nor the experiment's;
            a setting of a stage that a published low level replaces asks for the whole chain.

    Raises:
        StageError: unknown experiment, preset or method.
    """
    experiment = of_robot(known(EXPERIMENTS, name, "experiment"), robot)
    known(METHODS, method, "method")
    settings = settings or {}
    context = replace(context, or_begin=True)
    chain = _Chain(experiment, context, preset, method, list(mocap), settings)
    whole = from_scratch or mocap or not settings.keys().isdisjoint(before_high(experiment))
    low = None if whole else published_low(experiment, method)
    if low is not None:
        context.progress.say(
            f"starting from the published low level {low.stem}; --from-scratch trains another one"
        )
    return list(chain.run(range(context.seed, context.seed + seeds), low))


def before_high(experiment: Experiment) -> tuple[str, ...]:
    """The stages that a published low level replaces."""
    return (*experiment.motion_stages, "train-low")


def stages_of(experiment: Experiment) -> tuple[str, ...]:
    """The verbs of a whole chain, in their order."""
    return (*before_high(experiment), "train-high", "eval", "export", "play")


def config_of(experiment: Experiment, verb: str, *, preset: str, method: str) -> Any:
    """The config that a stage of an experiment gets, before any settings.

    Raises:
        StageError: unknown preset or method.
    """
    module = import_module(f"lacoloco.pipelines.{STAGES[verb]}")
    config = known(module.PRESETS, preset, "preset")()
    config = replace(config, **experiment.settings.get(verb, {}))
    if preset != "smoke":
        config = changed(config, experiment.balance.get(verb, {}))
    if verb == "train-low":
        discriminator, constrained = known(METHODS, method, "method")
        ase = replace(config.ase, discriminator=discriminator)
        config = replace(config, cat=constrained, ase=ase)
    if verb == "eval":
        config = replace(config, episodes=min(config.episodes, experiment.episodes))
    if verb == "train-high" and experiment.decisions is not None:
        config = replace(config, decisions=min(config.decisions, experiment.decisions))
    return config


def changed(config: Any, values: Mapping[str, Any]) -> Any:
    """A config with other values in some fields, named by their dotted paths."""
    for path, value in values.items():
        name, _, rest = path.partition(".")
        inner = changed(getattr(config, name), {rest: value}) if rest else value
        config = replace(config, **{name: inner})
    return config


def published_low(experiment: Experiment, method: str) -> Path | None:
    """The published policy whose low level an experiment may start from, None where none was
    trained by this method.
    """
    from lacoloco.datasets import published
    from lacoloco.datasets.artifact import read_header

    found = [path for name in experiment.start_from if (path := published.find(name)) is not None]
    return next(
        (path for path in found if read_header(path).metadata.get("method") == method), None
    )


def of_robot(experiment: Experiment, robot: str | None) -> Experiment:
    """The experiment with another robot, for which nothing is published."""
    if robot is None or robot == experiment.robot:
        return experiment
    return replace(experiment, robot=robot, start_from=())


def make_motions(
    name: str,
    context: StageContext,
    *,
    preset: str,
    mocap: Sequence[Path] = (),
    settings: Settings | None = None,
    robot: str | None = None,
) -> list[Path]:
    """The motions that an experiment's low level learns from; those that were made the same way are
    kept.

    Raises:
        StageError: unknown experiment or preset.
    """
    chain = _resuming(name, context, preset, mocap=mocap, robot=robot, settings=settings)
    learn_from = chain.experiment.learn_from
    needed = {*learn_from, *(INPUT_OF[verb] for verb in learn_from if verb in INPUT_OF)}
    made = {
        verb: chain.stage(verb, chain.context, **chain.sources(verb)).artifact
        for verb in chain.experiment.motion_stages
        if verb in needed
    }
    return [made[verb] for verb in learn_from]


def train_both(
    name: str,
    context: StageContext,
    *,
    preset: str,
    method: str,
    settings: Settings | None = None,
    motions: Sequence[Path] = (),
    robot: str | None = None,
) -> Path:
    """Both levels of one method and seed; a level that was trained the same way is kept.

    Args:
        name: a key of ``EXPERIMENTS``.
        context: run, seed, device.
        preset: preset of both stages.
        method: a key of ``METHODS``.
        settings: fields of the stages' configs.
        motions: what the low level learns from; default: the run's newest of the robot.
        robot: another robot than the experiment's.

    Returns:
        The high level's artifact.

    Raises:
        StageError: unknown experiment, preset or method, or the run has no motions of the robot.
    """
    chain = _resuming(name, context, preset, method, settings=settings, robot=robot)
    motions = list(motions) or [chain.newest(verb) for verb in chain.experiment.learn_from]
    low = chain.stage("train-low", chain.context, motions=motions)
    return chain.stage("train-high", chain.context, low=low.artifact).artifact


def trained_levels(
    name: str,
    context: StageContext,
    *,
    preset: str,
    method: str,
    settings: Settings | None,
    motions: Sequence[Path],
    robot: str | None,
) -> tuple[Path | None, Path | None]:
    """The low and the high level that ``train_both`` would keep, None where it would train."""
    chain = _resuming(name, context, preset, method, settings=settings, robot=robot)
    low = chain.done("train-low", chain.context, motions=list(motions))
    return low, chain.done("train-high", chain.context, low=low) if low is not None else None


def evaluate(
    name: str,
    context: StageContext,
    *,
    preset: str,
    policies: Sequence[Path],
    settings: Settings | None = None,
) -> Outcome:
    """Evaluate high levels of several methods and seeds together, one row each.

    Raises:
        StageError: unknown experiment or preset.
    """
    chain = _resuming(name, context, preset, settings=settings)
    return chain.stage("eval", context, policies=list(policies))


def _resuming(
    name: str,
    context: StageContext,
    preset: str,
    method: str = "drail-cat",
    mocap: Sequence[Path] = (),
    settings: Settings | None = None,
    robot: str | None = None,
) -> _Chain:
    experiment = of_robot(known(EXPERIMENTS, name, "experiment"), robot)
    known(METHODS, method, "method")
    resuming = replace(context, resume=True, or_begin=True)
    return _Chain(experiment, resuming, preset, method, list(mocap), settings or {})


class _Chain:
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
