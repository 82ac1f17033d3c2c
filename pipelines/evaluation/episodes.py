"""Episodes of the reach task, played to their end and counted: the evaluation of two policies."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np
import torch

from lacoloco.pipelines.evaluation.failure_analysis import (
    FailureCluster,
    episode_parameters,
    failure_clusters,
)
from lacoloco.pipelines.evaluation.intervals import Estimator, bootstrap, unanimous
from lacoloco.pipelines.learn.latents import project
from lacoloco.pipelines.policies import Policy, steered
from lacoloco.pipelines.sim.env import LeggedEnv
from lacoloco.pipelines.sim.hierarchical_env import HOLD_STEPS
from lacoloco.pipelines.sim.randomisation import Randomisation
from lacoloco.pipelines.sim.tasks import Task, load_task
from lacoloco.pipelines.stage import SILENT, Progress
from lacoloco.robots.numbers import SkillThresholds
from lacoloco.robots.spec import RobotSpec

METRICS = (
    "ee_error_mean_m",
    "ee_error_std_m",
    "ee_error_median_m",
    "contact_violation_pct",
    "contact_violation_original_pct",
    "contact_violation_original_any_foot_pct",
    "falls_pct",
    "not_reached_pct",
    "success_5cm_pct",
    "success_30cm_pct",
)
SHARES = ("falls_pct", "not_reached_pct", "success_5cm_pct", "success_30cm_pct")
"""Metrics that are a share of the episodes."""
OUTCOMES = (
    *("error", "fell", "above_limit", "substeps", "samples", "samples_above", "samples_any"),
    "diverged",
)
"""Fields of :class:`Episodes` that are counted while they are played."""


@dataclass(frozen=True)
class Episodes:
    """Outcomes of E episodes.

    Attributes:
        error: (E,) distance of the end effector from the target at the last step before the end
            [m].
        fell: (E,) bool.
        above_limit: (E, F) substeps in which a foot's contact force exceeded the limit.
        substeps: (E,) substeps lived through.
        samples: (E,) looks of the original's estimator, ten a second.
        samples_above: (E, F) of these, looks at a foot that found its largest force of the last
            15 ms above the limit.
        samples_any: (E,) looks that found any foot so.
        thresholds: of the robot: how near to a target is there.
        parameters: What differed between them, (E,) each; see
            :func:`lacoloco.pipelines.evaluation.failure_analysis.episode_parameters`.
        diverged: (E,) bool, of those that fell, the episodes whose physics diverged: their errors
            are no distances, and no part of the mean, spread and median; default: none.
    """

    error: np.ndarray
    fell: np.ndarray
    above_limit: np.ndarray
    substeps: np.ndarray
    samples: np.ndarray
    samples_above: np.ndarray
    samples_any: np.ndarray
    thresholds: SkillThresholds
    parameters: Mapping[str, np.ndarray] = field(default_factory=dict)
    diverged: np.ndarray = field(default_factory=lambda: np.zeros(0, dtype=bool))

    def __post_init__(self) -> None:
        """Count as diverged what is said to be, and what ended nowhere."""
        told = self.diverged if len(self.diverged) else np.zeros(len(self.error), dtype=bool)
        object.__setattr__(self, "diverged", told | ~np.isfinite(self.error))

    @property
    def not_reached(self) -> np.ndarray:
        """(E,) bool, ended without a fall further away than the robot's
        ``not_reached``.
        """
        return ~self.fell & (self.error > self.thresholds.not_reached)

    @property
    def no_progress(self) -> np.ndarray:
        """(E,) bool, not reached, and ended about as far from the target as the base was at the
        start.
        """
        nearest = self.parameters["target_distance_m"] - self.thresholds.no_progress
        return self.not_reached & (self.error > nearest)

    def arrays(self) -> dict[str, np.ndarray]:
        """All of it by name, the parameters behind a slash."""
        outcomes = {name: getattr(self, name) for name in OUTCOMES}
        return outcomes | {f"parameters/{name}": values for name, values in self.parameters.items()}

    def success(self, distance: float) -> np.ndarray:
        """(E,) bool, ended without a fall within ``distance`` [m] of the target."""
        return ~self.fell & (self.error <= distance)

    def failure_clusters(self) -> list[FailureCluster]:
        """Where episodes with a fall, and those that do not reach the target, cluster."""
        failures = {"falls": self.fell, "not_reached": self.not_reached}
        return failure_clusters(failures, self.parameters)

    def metrics(self) -> dict[str, float]:
        """Table I's columns, and the outcomes that its mean hides.

        Mean, std and median of the error [m]; share of foot-substeps with a force above the limit
        [%]; the same by the original's estimator [%], per foot and of any foot (see
        :class:`lacoloco.pipelines.sim.hierarchical_env.Decision`); shares of the episodes [%] that
        end in a fall, that end without one beyond the robot's ``not_reached`` distance, and that
        end without one within 5 cm and within 30 cm.
        """
        everyone = np.arange(len(self.error))[None]
        return {name: float(estimate(everyone)[0]) for name, estimate in self._estimators().items()}

    def intervals(self) -> dict[str, list[float]]:
        """95 % interval [low, high] of every metric: episodes resampled with a fixed seed.

        A share of no or of all episodes has its exact binomial bound instead.
        """
        found = bootstrap(self._estimators(), len(self.error))
        for name, value in self.metrics().items():
            if name in SHARES and value in (0.0, 100.0):
                found[name] = unanimous(value == 100.0, len(self.error))
        return found

    def _of_error(self) -> tuple[Estimator, Estimator, Estimator]:
        """Mean, spread and median of the error over the episodes that did not diverge."""
        reductions = (np.mean, np.std, np.median)
        error = self.error
        if self.diverged.any():
            reductions = (np.nanmean, np.nanstd, np.nanmedian)
            error = np.where(self.diverged, np.nan, error)
        mean, std, median = (partial(_over_known, reduce, error) for reduce in reductions)
        return mean, std, median

    def _estimators(self) -> dict[str, Estimator]:
        """Every metric as a function of the numbers (R, E) of episodes."""
        above, feet = self.above_limit.sum(axis=1), self.above_limit.shape[1]

        def ratio(part: np.ndarray, whole: np.ndarray, each: int) -> Estimator:
            return lambda rows: (
                100.0 * part[rows].sum(axis=1) / np.maximum(whole[rows].sum(axis=1) * each, 1.0)
            )

        def share(hit: np.ndarray) -> Estimator:
            return lambda rows: 100.0 * hit[rows].mean(axis=1)

        estimators = (
            *self._of_error(),
            ratio(above, self.substeps, feet),
            ratio(self.samples_above.sum(axis=1), self.samples, feet),
            ratio(self.samples_any, self.samples, 1),
            share(self.fell),
            share(self.not_reached),
            share(self.success(0.05)),
            share(self.success(0.30)),
        )
        return dict(zip(METRICS, estimators, strict=True))


def _over_known(
    reduce: Callable[..., np.ndarray], values: np.ndarray, rows: np.ndarray
) -> np.ndarray:
    """A metric of those of the numbers (R, E) that are known; NaN where none is."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)  # of a row without any
        return reduce(values[rows], axis=1)


def play_episodes(
    spec: RobotSpec,
    policies: Mapping[str, Policy],
    episodes: int,
    *,
    worlds: int,
    seed: int,
    device: str = "cpu",
    randomisation: Randomisation | None = None,
    task: Task | None = None,
    progress: Progress = SILENT,
) -> Episodes:
    """Play ``episodes`` episodes, each in a world with its own randomisation, motors as strong as
    they are, noise off.

    Pushes and randomisation stay on, as in the original's evaluation. Without a policy
    ``high`` every decision is a random latent, which is what an untrained high level amounts to.
    ``randomisation`` takes the place of the task's, ``task`` that of the robot's reach task.
    """
    worlds = min(worlds, episodes)
    task = replace(task or load_task(spec, "reach"), noise=0.0, training_limits=False)
    task = replace(task, randomisation=randomisation or task.randomisation)
    parts = []
    for chunk in range(-(-episodes // worlds)):
        parts.append(_play(spec, task, policies, worlds, seed + chunk, device))
        progress.advance(min((chunk + 1) * worlds, episodes))
    return _joined(parts, episodes)


def _joined(parts: list[Episodes], episodes: int) -> Episodes:
    """The first ``episodes`` of them."""

    def join(arrays: Iterable[np.ndarray]) -> np.ndarray:
        return np.concatenate(list(arrays))[:episodes]

    outcomes = {name: join(getattr(part, name) for part in parts) for name in OUTCOMES}
    given = {name: join(part.parameters[name] for part in parts) for name in parts[0].parameters}
    return Episodes(**outcomes, thresholds=parts[0].thresholds, parameters=given)


def _play(
    spec: RobotSpec, task: Task, policies: Mapping[str, Policy], worlds: int, seed: int, device: str
) -> Episodes:
    base = LeggedEnv(spec, task, worlds, seed=seed, device=device)
    env = steered(base, policies)
    generator = torch.Generator().manual_seed(seed)
    given = {name: values.cpu().numpy().copy() for name, values in episode_parameters(base).items()}
    alive = torch.ones(worlds, dtype=torch.bool, device=env.device)
    fell, diverged = torch.zeros_like(alive), torch.zeros_like(alive)
    error = torch.zeros(worlds, device=env.device)
    above = torch.zeros(worlds, len(spec.feet), device=env.device)
    lived = torch.zeros(worlds, device=env.device)
    samples, samples_any = torch.zeros_like(lived), torch.zeros_like(lived)
    samples_above = torch.zeros_like(above)
    for _ in range(task.episode_steps // HOLD_STEPS):
        if "high" in policies:
            raw = policies["high"](env.observe())
        else:
            raw = torch.randn(env.latent.shape, generator=generator).to(env.device)
        decision = env.step(project(raw))
        error = torch.where(alive, decision.error, error)
        above += decision.above_limit * alive[:, None]
        lived += decision.substeps * alive
        samples += decision.sampled & alive
        samples_above += decision.sampled_above & alive[:, None]
        samples_any += decision.sampled_above.any(dim=1) & alive
        fell |= decision.fell & alive
        diverged |= decision.diverged & alive
        alive &= ~decision.done
    return Episodes(
        error=error.cpu().numpy(),
        fell=fell.cpu().numpy(),
        above_limit=above.cpu().numpy(),
        substeps=lived.cpu().numpy(),
        samples=samples.cpu().numpy(),
        samples_above=samples_above.cpu().numpy(),
        samples_any=samples_any.cpu().numpy(),
        diverged=diverged.cpu().numpy(),
        thresholds=spec.skills,
        parameters=given,
    )
