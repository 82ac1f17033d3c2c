"""The chains of stages, quickstart and the paper's experiments: the only place where stages
meet.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from lacoloco.datasets.errors import ArtifactError
from lacoloco.datasets.store import StageDir
from lacoloco.pipelines.chains.chain_stages import ChainStages, Outcome
from lacoloco.pipelines.chains.experiments import (
    EXPERIMENTS,
    INPUT_OF,
    METHODS,
    Experiment,
    known,
)
from lacoloco.pipelines.chains.stage_configs import PAPER_METHOD, Settings, before_high
from lacoloco.pipelines.errors import StageError
from lacoloco.pipelines.stage import StageContext


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
            a setting of a stage that a published low level replaces asks for the whole chain, and
            so does the preset of the paper's method: ours made what is published.

    Raises:
        StageError: unknown experiment, preset or method.
    """
    experiment = of_robot(known(EXPERIMENTS, name, "experiment"), robot)
    known(METHODS, method, "method")
    settings = settings or {}
    context = replace(context, or_begin=True)
    chain = ChainStages(experiment, context, preset, method, list(mocap), settings)
    changed = not settings.keys().isdisjoint(before_high(experiment))
    whole = from_scratch or mocap or changed or preset == PAPER_METHOD
    low = None if whole else published_low(experiment, method)
    if low is not None:
        context.progress.say(
            f"starting from the published low level {low.stem}; --from-scratch trains another one"
        )
    return list(chain.run(range(context.seed, context.seed + seeds), low))


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


def made_motions(
    name: str, context: StageContext, *, robot: str | None = None
) -> list[Path] | None:
    """The newest motions of an experiment in a run, None where some are missing."""
    chain = _resuming(name, context, "laptop", robot=robot)
    try:
        return [chain.newest(verb) for verb in chain.experiment.learn_from]
    except (StageError, ArtifactError):
        return None


@dataclass(frozen=True)
class Levels:
    """What there is of both levels of one method and seed.

    Attributes:
        low: what ``train_both`` would keep, None where it would train.
        high: the same of the high level.
        unfinished: what it would go on with.
    """

    low: Path | None
    high: Path | None
    unfinished: tuple[StageDir, ...]


def trained_levels(
    name: str,
    context: StageContext,
    *,
    preset: str,
    method: str,
    settings: Settings | None,
    motions: Sequence[Path],
    robot: str | None,
) -> Levels:
    """What ``train_both`` would find."""
    chain = _resuming(name, context, preset, method, settings=settings, robot=robot)
    low = chain.done("train-low", chain.context, motions=list(motions))
    if low is None:
        begun = chain.unfinished("train-low", chain.context, motions=list(motions))
        return Levels(None, None, begun)
    high = chain.done("train-high", chain.context, low=low)
    return Levels(low, high, () if high else chain.unfinished("train-high", chain.context, low=low))


def evaluate(
    name: str,
    context: StageContext,
    *,
    preset: str,
    policies: Sequence[Path],
    names: Sequence[str] = (),
    settings: Settings | None = None,
) -> Outcome:
    """Evaluate high levels of several methods and seeds together, one row each; ``names`` are of
    the rows, where their methods do not tell them apart.

    Raises:
        StageError: unknown experiment or preset.
    """
    chain = _resuming(name, context, preset, settings=settings)
    named = {"names": list(names)} if names else {}
    return chain.stage("eval", context, policies=list(policies), **named)


def _resuming(
    name: str,
    context: StageContext,
    preset: str,
    method: str = "drail-cat",
    mocap: Sequence[Path] = (),
    settings: Settings | None = None,
    robot: str | None = None,
) -> ChainStages:
    experiment = of_robot(known(EXPERIMENTS, name, "experiment"), robot)
    known(METHODS, method, "method")
    resuming = replace(context, resume=True, or_begin=True)
    return ChainStages(experiment, resuming, preset, method, list(mocap), settings or {})
