"""Stage eval: both levels on fresh episodes of their task; for reaching, the paper's Table I."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from functools import partial
from pathlib import Path
from typing import Annotated, Any

import numpy as np

from lacoloco.datasets.artifact import Artifact, write_artifact
from lacoloco.datasets.config_values import Rising, Within, Worlds, check_config
from lacoloco.datasets.hardware import describe_machine
from lacoloco.pipelines.errors import StageError
from lacoloco.pipelines.evaluation.episodes import METRICS, Episodes, play_episodes
from lacoloco.pipelines.evaluation.task_reward import task_reward
from lacoloco.pipelines.policies import Policy, load_policies, task_of
from lacoloco.pipelines.robot import record_of, robot_of
from lacoloco.pipelines.sim.randomisation import Randomisation
from lacoloco.pipelines.sim.tasks import Task
from lacoloco.pipelines.stage import StageContext, StageResult
from lacoloco.robots.spec import RobotSpec

TEST_SEED, SELECTION_SEED = 1_000_003, 2_000_003
"""Episodes that are reported, and other episodes on which the best seed is chosen."""


@dataclass(frozen=True)
class EvalConfig:
    """How much is evaluated.

    Attributes:
        episodes: reported episodes per policy (paper: 4096).
        selection_episodes: further ones, to choose the best of several seeds.
        worlds: how many run at once.
        friction: range of the friction instead of the task's; both ends equal for one value.
        mass_scale: the same of the factor on all masses.
    """

    episodes: Annotated[int, Within(1, 10**7)] = 4096
    selection_episodes: Annotated[int, Within(1, 10**7)] = 1024
    worlds: Worlds = 1024
    friction: Annotated[tuple[float, float], Within(0, 1000, above=True), Rising()] | None = None
    mass_scale: Annotated[tuple[float, float], Within(0, 1000, above=True), Rising()] | None = None

    def randomisation(self, usual: Randomisation) -> Randomisation:
        """The task's, with the ranges given here."""
        given: dict[str, Any] = {"friction": self.friction, "mass_scale": self.mass_scale}
        return replace(usual, **{name: value for name, value in given.items() if value is not None})


PRESETS: dict[str, Callable[[], EvalConfig]] = {
    "smoke": lambda: EvalConfig(episodes=16, selection_episodes=8, worlds=16),
    "laptop": lambda: EvalConfig(),
    "gpu": lambda: EvalConfig(worlds=4096),
    "paper": lambda: EvalConfig(worlds=4096),
}


def run(config: EvalConfig, context: StageContext, *, policies: Sequence[Path]) -> StageResult:
    """Evaluate high-level artifacts, one row each, and the best of them by episodes that are not
    reported.

    Raises:
        ArtifactError: an input is missing, damaged, or holds no high level.
        ConfigError: a value that its field does not allow.
        StageError: policies of tasks that cannot be compared.
    """
    check_config(config)
    directory = context.store.begin(context.run, "eval")
    rows: list[dict[str, Any]] = []
    arrays: dict[str, np.ndarray] = {}
    for index, path in enumerate(policies):
        artifact, loaded = load_policies(path, "low", "high", device=context.device)
        spec = robot_of(artifact, context.progress.say)
        context.progress.start(
            f"eval {artifact.metadata['method']} seed {artifact.seed}", config.episodes
        )
        task = task_of(artifact, spec)
        task = replace(task, randomisation=config.randomisation(task.randomisation))
        if not task.has_target:
            rows.append(_reward_row(artifact, path, spec, task, loaded, config, context))
            context.progress.stop()
            continue
        play = partial(
            play_episodes, spec, loaded, worlds=config.worlds, device=context.device, task=task
        )
        reported = play(config.episodes, seed=TEST_SEED, progress=context.progress)
        chosen = play(config.selection_episodes, seed=SELECTION_SEED)
        rows.append(_row(artifact, path, config, reported, chosen))
        arrays |= {f"{index}/{name}": value for name, value in reported.arrays().items()}
        context.progress.stop()
    if len({"task_reward" in row for row in rows}) > 1:
        raise StageError("policies with a target and without one: evaluate them one kind at a time")
    best = min(rows, key=_selection)
    metadata = {"rows": rows, "best": best, "summary": summary(rows)}
    robot = record_of(spec)
    write_artifact(
        directory.file("artifact.h5"),
        "lacoloco/evaluation",
        arrays,
        metadata=metadata | {"hardware": {"device": context.device, **describe_machine()}},
        config=asdict(config),
        seed=context.seed,
        robot=robot,
        parents=list(policies),
        command=context.command,
    )
    return StageResult(directory.complete(), metadata)


def summary(rows: list[dict[str, Any]]) -> dict[str, dict[str, float]]:
    """Mean and sample standard deviation over seeds of every metric, by method."""
    result: dict[str, dict[str, float]] = {}
    for method in dict.fromkeys(row["method"] for row in rows):
        for metric in (*METRICS, "task_reward"):
            if metric not in rows[0]:
                continue
            values = np.array([row[metric] for row in rows if row["method"] == method])
            entry = result.setdefault(method, {"seeds": len(values)})
            entry[f"{metric}_mean"] = float(values.mean())
            entry[f"{metric}_spread"] = float(values.std(ddof=1)) if len(values) > 1 else 0.0
    return result


def _selection(row: dict[str, Any]) -> float:
    """What the best policy has least of, on episodes that are not reported."""
    return -row["selection_reward"] if "task_reward" in row else row["selection_error_m"]


def _reward_row(
    artifact: Artifact,
    path: Path,
    spec: RobotSpec,
    task: Task,
    policies: Mapping[str, Policy],
    config: EvalConfig,
    context: StageContext,
) -> dict[str, Any]:
    """The row of a policy whose task has no target: what the task pays it per second."""
    reported = task_reward(
        spec, task, policies, episodes=config.episodes, seed=TEST_SEED, device=context.device
    )
    chosen = task_reward(
        spec,
        task,
        policies,
        episodes=config.selection_episodes,
        seed=SELECTION_SEED,
        device=context.device,
    )
    return {
        "method": artifact.metadata["method"],
        "seed": artifact.seed,
        "episodes": config.episodes,
        "task": task.name,
        **reported,
        "selection_reward": chosen["task_reward"],
        "policy": str(path),
    }


def _row(
    artifact: Artifact, path: Path, config: EvalConfig, reported: Episodes, chosen: Episodes
) -> dict[str, Any]:
    return {
        "method": artifact.metadata["method"],
        "seed": artifact.seed,
        "episodes": config.episodes,
        **reported.metrics(),
        "not_reached": int(reported.not_reached.sum()),
        "no_progress": int(reported.no_progress.sum()),
        "failure_clusters": reported.failure_clusters(),
        "selection_error_m": chosen.metrics()["ee_error_mean_m"],
        "policy": str(path),
    }
