"""One experiment for several methods and seeds, each a trial trained in a job of its own.

What there is to do is read off the run: a trial whose policy is there, with the same config, robot
and inputs, is done, one that was cut short goes on from its checkpoint, one that failed is tried
again. So the same command, given again, does what is missing and nothing else.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import product
from pathlib import Path
from typing import Any

from lacoloco.datasets.artifact import read_header
from lacoloco.datasets.store import RunStore
from lacoloco.pipelines.chains import chain
from lacoloco.pipelines.chains.experiments import METHODS
from lacoloco.pipelines.chains.jobs import make_executor, run_jobs
from lacoloco.pipelines.errors import StageError
from lacoloco.pipelines.stage import StageContext

JOBS = "jobs"
"""Folder of a run for the jobs' output."""


@dataclass(frozen=True)
class Trial:
    """One method with one seed, and how far it is.

    Attributes:
        status: ``done``, ``failed`` (in this call), ``unfinished`` (a training was cut short) or
            ``missing``.
        samples: control steps of the training it is at, as far as they are logged.
        low: its low level, if there is one.
        high: its high level, if there is one.
        error: one line of what went wrong.
        seconds: of its job in this call.
    """

    method: str
    seed: int
    status: str = "missing"
    samples: int = 0
    low: Path | None = None
    high: Path | None = None
    error: str = ""
    seconds: float = 0.0

    @property
    def name(self) -> str:
        """Also the label of its trainings."""
        return f"{self.method}-seed{self.seed}"


def chosen_methods(text: str) -> list[str]:
    """The methods in ``all`` or in names separated by commas.

    Raises:
        StageError: a name that is no method.
    """
    names = (
        list(METHODS)
        if text == "all"
        else [name.strip() for name in text.split(",") if name.strip()]
    )
    unknown = [name for name in names if name not in METHODS]
    if unknown or not names:
        raise StageError(f"--methods {text}: use all, or some of {', '.join(METHODS)}")
    return list(dict.fromkeys(names))


def trials(store: RunStore, run: str, methods: Iterable[str], seeds: Iterable[int]) -> list[Trial]:
    """Every trial, method by method, as the run shows it: its newest policies of that method and
    seed, whatever their settings.
    """
    found = []
    for method, seed in product(methods, seeds):
        trial = Trial(method, seed)
        low, high = (_trained(store, run, stage, trial) for stage in chain.TRAININGS)
        found.append(_look(store, run, trial, low, high))
    return found


def run_trials(
    name: str,
    context: StageContext,
    *,
    preset: str,
    methods: Sequence[str],
    seeds: int,
    executor: str = "local",
    at_once: int = 1,
    options: Mapping[str, Any] | None = None,
    mocap: Sequence[Path] = (),
    settings: chain.Settings | None = None,
    robot: str | None = None,
) -> tuple[list[Trial], chain.Outcome | None]:
    """Make the motions if there are none, train what is missing, and evaluate all that is there.

    Args:
        name: a key of ``EXPERIMENTS``.
        context: run, first seed, device.
        preset: preset of every stage.
        methods: keys of ``METHODS``.
        seeds: per method, from ``context.seed`` upwards.
        executor: ``local`` or ``slurm``.
        at_once: so many jobs at a time.
        options: Slurm's parameters.
        mocap: files to retarget instead of the bundled sample.
        settings: fields of the stages' configs, the same for all trials.
        robot: another robot than the experiment's, by name or by the path of its folder.

    Returns:
        The trials, and the evaluation of those that are done; None when none is.

    Raises:
        StageError: the experiment, preset or executor does not exist.
    """
    store, run, progress = context.store, context.run, context.progress
    numbers = range(context.seed, context.seed + seeds)
    jobs_folder = store.directory(run) / JOBS
    machine = make_executor(executor, jobs_folder, options)
    motions = chain.make_motions(
        name, context, preset=preset, mocap=mocap, robot=robot, settings=settings
    )

    def look(trial: Trial) -> Trial:
        low, high = chain.trained_levels(
            name,
            replace(context, seed=trial.seed),
            preset=preset,
            method=trial.method,
            settings=settings,
            motions=motions,
            robot=robot,
        )
        return _look(store, run, trial, low, high)

    asked = [Trial(method, seed) for method, seed in product(methods, numbers)]
    found = {trial.name: look(trial) for trial in asked}
    todo = [trial for trial in found.values() if trial.status != "done"]
    shared = (name, str(store.root.resolve()), run, preset, settings or {})
    made = [str(path.resolve()) for path in motions]
    work = {
        m.name: (*shared, m.method, m.seed, context.device, context.command, made, robot)
        for m in todo
    }
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
    policies = [trial.high for trial in found.values() if trial.high is not None]
    if not policies:
        return list(found.values()), None
    evaluation = chain.evaluate(name, context, preset=preset, policies=policies, settings=settings)
    return list(found.values()), evaluation


def train_trial(
    name: str,
    root: str,
    run: str,
    preset: str,
    settings: chain.Settings,
    method: str,
    seed: int,
    device: str,
    command: str,
    motions: Sequence[str],
    robot: str | None,
) -> None:
    """Both levels of one trial, as far as they are not there: what a job does."""
    context = StageContext(
        RunStore(Path(root)), run, seed=seed, device=device, resume=True, command=command
    )
    chain.train_both(
        name,
        context,
        preset=preset,
        method=method,
        settings=settings,
        motions=[Path(path) for path in motions],
        robot=robot,
    )


def _look(store: RunStore, run: str, trial: Trial, low: Path | None, high: Path | None) -> Trial:
    """The trial with its levels, and how far it is."""
    partials = [
        part for stage in chain.TRAININGS for part in store.partials(run, stage, trial.name)
    ]
    status = "done" if high else "unfinished" if partials or low else "missing"
    samples = _samples(partials[-1].path) if partials else 0
    return replace(trial, status=status, samples=samples, low=low, high=high)


def _trained(store: RunStore, run: str, stage: str, trial: Trial) -> Path | None:
    for path in reversed(store.all(run, stage)):
        header = read_header(path)
        if header.seed == trial.seed and header.metadata.get("method") == trial.method:
            return path
    return None


def _samples(directory: Path) -> int:
    try:
        last = (directory / "metrics.jsonl").read_text().splitlines()[-1]
        return int(json.loads(last)["samples"])
    except (OSError, IndexError, ValueError, KeyError):  # no line yet, or half of one
        return 0
