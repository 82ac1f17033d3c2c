"""Episodes of the reach task, played to their end and counted: the evaluation of two policies."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace

import numpy as np
import torch

from lacoloco.pipelines.evaluation.failure_analysis import (
    FailureCluster,
    episode_parameters,
    failure_clusters,
)
from lacoloco.pipelines.learn.latents import project
from lacoloco.pipelines.policies import Policy
from lacoloco.pipelines.sim.env import LeggedEnv
from lacoloco.pipelines.sim.hierarchical_env import HOLD_STEPS, LatentSteeredEnv
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
    "falls_pct",
    "not_reached_pct",
    "success_5cm_pct",
    "success_30cm_pct",
)
OUTCOMES = ("error", "fell", "above_limit", "substeps")
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
        thresholds: of the robot: how near to a target is there.
        parameters: What differed between them, (E,) each; see
            :func:`lacoloco.pipelines.evaluation.failure_analysis.episode_parameters`.
    """

    error: np.ndarray
    fell: np.ndarray
    above_limit: np.ndarray
    substeps: np.ndarray
    thresholds: SkillThresholds
    parameters: Mapping[str, np.ndarray] = field(default_factory=dict)

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
        [%]; shares of the episodes [%] that end in a fall, that end without one beyond the robot's
        ``not_reached`` distance, and that end without one within 5 cm and within 30 cm.
        """
        feet = self.above_limit.shape[1]
        values = (
            self.error.mean(),
            self.error.std(),
            np.median(self.error),
            100.0 * self.above_limit.sum() / max(self.substeps.sum() * feet, 1.0),
            100.0 * self.fell.mean(),
            100.0 * self.not_reached.mean(),
            100.0 * self.success(0.05).mean(),
            100.0 * self.success(0.30).mean(),
        )
        return dict(zip(METRICS, map(float, values), strict=True))


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
    env = LatentSteeredEnv(base, policies["low"], policies["low"].head.sizes["latent"])
    generator = torch.Generator().manual_seed(seed)
    given = {name: values.cpu().numpy().copy() for name, values in episode_parameters(base).items()}
    alive = torch.ones(worlds, dtype=torch.bool, device=env.device)
    fell, error = torch.zeros_like(alive), torch.zeros(worlds, device=env.device)
    above = torch.zeros(worlds, len(spec.feet), device=env.device)
    lived = torch.zeros(worlds, device=env.device)
    for _ in range(task.episode_steps // HOLD_STEPS):
        if "high" in policies:
            raw = policies["high"](env.observe())
        else:
            raw = torch.randn(env.latent.shape, generator=generator).to(env.device)
        decision = env.step(project(raw))
        error = torch.where(alive, decision.error, error)
        above += decision.above_limit * alive[:, None]
        lived += decision.substeps * alive
        fell |= decision.fell & alive
        alive &= ~decision.done
    return Episodes(
        error=error.cpu().numpy(),
        fell=fell.cpu().numpy(),
        above_limit=above.cpu().numpy(),
        substeps=lived.cpu().numpy(),
        thresholds=spec.skills,
        parameters=given,
    )
