"""Several variants and seeds, each a trial trained in a job of its own.

What there is to do is read off the run: a trial whose policy is there, with the same config, robot
and inputs, is done, one that was cut short goes on from its checkpoint, one that failed is tried
again. So the same command, given again, does what is missing and nothing else.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import product
from pathlib import Path
from typing import Any

from lacoloco.datasets.artifact import read_header
from lacoloco.datasets.store import RunStore, StageDir
from lacoloco.pipelines.chains import chain
from lacoloco.pipelines.chains.chain_stages import TRAININGS, Outcome
from lacoloco.pipelines.chains.jobs import make_executor, run_jobs
from lacoloco.pipelines.chains.variants import Variant
from lacoloco.pipelines.stage import StageContext

JOBS = "jobs"
"""Folder of a run for the jobs' output."""


@dataclass(frozen=True)
class Trial:
    """One variant with one seed, and how far it is.

    Attributes:
        status: ``done``, ``failed`` (in this call), ``unfinished`` (a training was cut short) or
            ``missing``.
        samples: control steps of the training it is at, or of its last one, as far as they are
            logged.
        low: its low level, if there is one.
        high: its high level, if there is one.
        error: one line of what went wrong.
        seconds: of its job in this call.
    """

    variant: Variant
    seed: int
    status: str = "missing"
    samples: int = 0
    low: Path | None = None
    high: Path | None = None
    error: str = ""
    seconds: float = 0.0

    @property
    def name(self) -> str:
        """Also the name of its job."""
        return f"{self.variant.name}-seed{self.seed}"


@dataclass(frozen=True)
class Asked:
    """What all trials of a call share.

    Attributes:
        preset: preset of every stage.
        robot: another robot than the experiment's, by name or by the path of its folder.
        mocap: files to retarget instead of the bundled sample.
    """

    preset: str
    robot: str | None = None
    mocap: tuple[Path, ...] = ()


def trials(
    context: StageContext, variants: Sequence[Variant], seeds: int, asked: Asked
) -> list[Trial]:
    """Every trial, variant by variant, as the run shows it, and nothing is made.

    Variants that only have a method show its newest policies, whatever their settings.
    """
    found = []
    for variant, seed in product(variants, range(context.seed, context.seed + seeds)):
        trial = Trial(variant, seed)
        if not variant.compared:
            found.append(_newest(context.store, context.run, trial))
            continue
        motions = chain.made_motions(variant.experiment, context, robot=asked.robot)
        found.append(_look(context, trial, motions, asked))
    return found


def run_trials(
    context: StageContext,
    variants: Sequence[Variant],
    seeds: int,
    asked: Asked,
    *,
    executor: str = "local",
    at_once: int = 1,
    options: Mapping[str, Any] | None = None,
) -> tuple[list[Trial], Outcome | None]:
    """Make the motions if there are none, train what is missing, and evaluate all that is there.

    Args:
        context: run, first seed, device.
        variants: what to compare.
        seeds: per variant, from ``context.seed`` upwards.
        asked: what they share.
        executor: ``local`` or ``slurm``.
        at_once: so many jobs at a time.
        options: Slurm's parameters.

    Returns:
        The trials, and the evaluation of those that are done; None when none is.

    Raises:
        StageError: the experiment, preset or executor does not exist.
    """
    store, run, progress = context.store, context.run, context.progress
    machine = make_executor(executor, store.directory(run) / JOBS, options)
    motions = {variant.name: _motions(context, variant, asked) for variant in variants}

    def look(trial: Trial) -> Trial:
        return _look(context, trial, motions[trial.variant.name], asked)

    numbers = range(context.seed, context.seed + seeds)
    every = [look(Trial(variant, seed)) for variant, seed in product(variants, numbers)]
    found = {trial.name: trial for trial in every}
    todo = [trial for trial in found.values() if trial.status != "done"]
    work = {one.name: _call(context, one, motions[one.variant.name], asked) for one in todo}
    progress.start(f"{len(todo)} of {len(found)} trials", len(todo))
    for count, ended in enumerate(run_jobs(machine, train_trial, work, at_once=at_once), 1):
        trial = look(found[ended.name])
        failed = trial.status != "done"
        error = (ended.error or "its job ended without a policy") if failed else ""
        status = "failed" if failed else "done"
        found[trial.name] = replace(trial, status=status, error=error, seconds=ended.seconds)
        progress.say(f"{trial.name}: {status}{f', {error}; see {ended.log}*' if failed else ''}")
        progress.advance(count)
    progress.stop()
    return list(found.values()), _evaluated(context, list(found.values()), asked)


def train_trial(
    root: str,
    run: str,
    seed: int,
    device: str,
    command: str,
    variant: Variant,
    motions: Sequence[str],
    preset: str,
    robot: str | None,
) -> None:
    """Both levels of one trial, as far as they are not there: what a job does."""
    context = StageContext(
        RunStore(Path(root)), run, seed=seed, device=device, resume=True, command=command
    )
    chain.train_both(
        variant.experiment,
        context,
        preset=preset,
        method=variant.method,
        settings=variant.settings,
        motions=[Path(path) for path in motions],
        robot=robot,
    )


def _motions(context: StageContext, variant: Variant, asked: Asked) -> list[Path]:
    return chain.make_motions(
        variant.experiment,
        context,
        preset=asked.preset,
        mocap=asked.mocap,
        robot=asked.robot,
        settings=variant.settings,
    )


def _call(
    context: StageContext, trial: Trial, motions: Sequence[Path], asked: Asked
) -> tuple[Any, ...]:
    """The arguments of ``train_trial``; paths whole, because a job begins elsewhere."""
    made = [str(path.resolve()) for path in motions]
    root = str(context.store.root.resolve())
    here = (root, context.run, trial.seed, context.device, context.command)
    return (*here, trial.variant, made, asked.preset, asked.robot)


def _evaluated(context: StageContext, found: list[Trial], asked: Asked) -> Outcome | None:
    """The evaluation of the trials that have a policy, None where none has."""
    done = [trial for trial in found if trial.high is not None]
    if not done:
        return None
    first = done[0].variant
    return chain.evaluate(
        first.experiment,
        context,
        preset=asked.preset,
        policies=[trial.high for trial in done if trial.high is not None],
        names=[trial.variant.name for trial in done] if first.compared else [],
        settings=first.settings,
    )


def _look(
    context: StageContext, trial: Trial, motions: Sequence[Path] | None, asked: Asked
) -> Trial:
    """The trial with the levels that were trained just so, and how far it is."""
    if motions is None:
        return trial
    levels = chain.trained_levels(
        trial.variant.experiment,
        replace(context, seed=trial.seed),
        preset=asked.preset,
        method=trial.variant.method,
        settings=trial.variant.settings,
        motions=motions,
        robot=asked.robot,
    )
    return _with(trial, levels.low, levels.high, levels.unfinished)


def _newest(store: RunStore, run: str, trial: Trial) -> Trial:
    """The trial with the newest levels of its method and seed, whatever their settings."""
    low, high = (_trained(store, run, stage, trial) for stage in TRAININGS)
    label = f"{trial.variant.method}-seed{trial.seed}"
    begun = [one for stage in TRAININGS for one in store.partials(run, stage, label)]
    return _with(trial, low, high, begun)


def _with(trial: Trial, low: Path | None, high: Path | None, begun: Sequence[StageDir]) -> Trial:
    status = "done" if high else "unfinished" if begun or low else "missing"
    last = begun[-1].path if begun else next((one.parent for one in (high, low) if one), None)
    samples = _samples(last) if last else 0
    return replace(trial, status=status, samples=samples, low=low, high=high)


def _trained(store: RunStore, run: str, stage: str, trial: Trial) -> Path | None:
    for path in reversed(store.all(run, stage)):
        header = read_header(path)
        if header.seed == trial.seed and header.metadata.get("method") == trial.variant.method:
            return path
    return None


def _samples(directory: Path) -> int:
    try:
        last = (directory / "metrics.jsonl").read_text().splitlines()[-1]
        return int(json.loads(last)["samples"])
    except (OSError, IndexError, ValueError, KeyError):  # no line yet, or half of one
        return 0
