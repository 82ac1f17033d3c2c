"""Stage eval: both levels on fresh episodes of the reach task: the paper's Table I."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import torch
from lacoloco.datasets.artifact import Artifact, write_artifact
from lacoloco.robots.registry import load_robot
from lacoloco.robots.spec import RobotSpec

from lacoloco.pipelines.learn.latents import project
from lacoloco.pipelines.policies import Policy, load_policies
from lacoloco.pipelines.sim.env import LeggedEnv
from lacoloco.pipelines.sim.hierarchy import HOLD_STEPS, LatentSteeredEnv
from lacoloco.pipelines.sim.tasks import reach_task
from lacoloco.pipelines.stage import StageContext, StageResult

TEST_SEED, SELECTION_SEED = 1_000_003, 2_000_003
"""Episodes that are reported, and other episodes on which the best seed is chosen."""
FIGURES = ("ee_error_mean_m", "ee_error_std_m", "contact_violation_pct", "falls_pct")


@dataclass(frozen=True)
class EvalConfig:
    """How much is evaluated.

    Attributes:
        episodes: reported episodes per policy (paper: 4096).
        selection_episodes: further ones, to choose the best of several seeds.
        worlds: how many run at once.
    """

    episodes: int = 4096
    selection_episodes: int = 1024
    worlds: int = 1024


PRESETS: dict[str, Callable[[], EvalConfig]] = {
    "smoke": lambda: EvalConfig(episodes=16, selection_episodes=8, worlds=16),
    "laptop": lambda: EvalConfig(),
}


@dataclass(frozen=True)
class Episodes:
    """Outcomes of E episodes.

    Attributes:
        error: (E,) distance of the end effector from the target at the last step before the end [m].
        fell: (E,) bool.
        above_limit: (E, F) substeps in which a foot's contact force exceeded the limit.
        substeps: (E,) substeps lived through.
    """

    error: np.ndarray
    fell: np.ndarray
    above_limit: np.ndarray
    substeps: np.ndarray

    def figures(self) -> dict[str, float]:
        """Table I's columns: error mean and std [m], share of foot-substeps above the limit [%], share of falls [%]."""
        feet = self.above_limit.shape[1]
        values = (
            self.error.mean(),
            self.error.std(),
            100.0 * self.above_limit.sum() / max(self.substeps.sum() * feet, 1.0),
            100.0 * self.fell.mean(),
        )
        return dict(zip(FIGURES, map(float, values), strict=True))


def run(config: EvalConfig, context: StageContext, *, policies: Sequence[Path]) -> StageResult:
    """Evaluate high-level artifacts, one row each, and the best of them by episodes that are not reported.

    Raises:
        ArtifactError: an input is missing, damaged, or holds no high level.
    """
    directory = context.store.begin(context.run, "eval")
    rows, arrays = [], {}
    for index, path in enumerate(policies):
        artifact, loaded = load_policies(path, "low", "high", device=context.device)
        spec = load_robot(artifact.robot)
        context.progress.start(f"eval {artifact.metadata['method']} seed {artifact.seed}", config.episodes)
        reported = play_episodes(spec, loaded, config.episodes, config.worlds, TEST_SEED, context)
        chosen = play_episodes(spec, loaded, config.selection_episodes, config.worlds, SELECTION_SEED, None)
        rows.append(_row(artifact, path, config, reported, chosen))
        arrays |= {f"{index}/{name}": value for name, value in asdict(reported).items()}
        context.progress.stop()
    best = min(rows, key=lambda row: row["selection_error_m"])
    metadata = {"rows": rows, "best": best, "summary": summary(rows)}
    robot = (spec.name, spec.model_hash())
    write_artifact(
        directory.file("artifact.h5"),
        "lacoloco/evaluation",
        arrays,
        metadata=metadata,
        config=asdict(config),
        seed=context.seed,
        robot=robot,
        parents=list(policies),
        command=context.command,
    )
    return StageResult(directory.complete(), metadata)


def summary(rows: list[dict[str, Any]]) -> dict[str, dict[str, float]]:
    """Mean and standard deviation over seeds of every figure, by method."""
    result: dict[str, dict[str, float]] = {}
    for method in dict.fromkeys(row["method"] for row in rows):
        for figure in FIGURES:
            values = np.array([row[figure] for row in rows if row["method"] == method])
            entry = result.setdefault(method, {"seeds": len(values)})
            entry[f"{figure}_mean"], entry[f"{figure}_spread"] = float(values.mean()), float(values.std())
    return result


def play_episodes(
    spec: RobotSpec,
    policies: dict[str, Policy],
    episodes: int,
    worlds: int,
    seed: int,
    context: StageContext | None,
    *,
    untrained: bool = False,
) -> Episodes:
    """Play ``episodes`` episodes, each in a world with its own randomisation, motors as strong as they are, noise off.

    Pushes and randomisation stay on, as in the original's evaluation (facts 2.2). ``untrained`` replaces the high level by
    one random latent per decision: what an untrained one does.
    """
    worlds = min(worlds, episodes)
    parts = []
    for chunk in range(-(-episodes // worlds)):
        parts.append(_chunk(spec, policies, worlds, seed + chunk, context, untrained))
        if context is not None:
            context.progress.advance(min((chunk + 1) * worlds, episodes))
    merged = {name: np.concatenate([getattr(part, name) for part in parts])[:episodes] for name in asdict(parts[0])}
    return Episodes(**merged)


def _chunk(
    spec: RobotSpec, policies: dict[str, Policy], worlds: int, seed: int, context: StageContext | None, untrained: bool
) -> Episodes:
    task = replace(reach_task(spec), noise=0.0, training_limits=False)
    base = LeggedEnv(spec, task, worlds, seed=seed, device=context.device if context else "cpu")
    env = LatentSteeredEnv(base, policies["low"], policies["low"].head.sizes["latent"])
    draw = torch.Generator().manual_seed(seed)
    alive = torch.ones(worlds, dtype=torch.bool, device=env.device)
    fell, error = torch.zeros_like(alive), torch.zeros(worlds, device=env.device)
    above = torch.zeros(worlds, len(spec.feet), device=env.device)
    lived = torch.zeros(worlds, device=env.device)
    for _ in range(task.episode_steps // HOLD_STEPS):
        if untrained:
            raw = torch.randn(worlds, env.latent.shape[1], generator=draw).to(env.device)
        else:
            raw = policies["high"](env.observe())
        decision = env.step(project(raw))
        error = torch.where(alive, decision.error, error)
        above += decision.above_limit * alive[:, None]
        lived += decision.substeps * alive
        fell |= decision.fell & alive
        alive &= ~decision.done
    return Episodes(*(tensor.cpu().numpy() for tensor in (error, fell, above, lived)))


def _row(artifact: Artifact, path: Path, config: EvalConfig, reported: Episodes, chosen: Episodes) -> dict[str, Any]:
    return {
        "method": artifact.metadata["method"],
        "seed": artifact.seed,
        "episodes": config.episodes,
        **reported.figures(),
        "selection_error_m": chosen.figures()["ee_error_mean_m"],
        "policy": str(path),
    }
