"""Stage eval: both levels on fresh episodes of their task; for reaching, the paper's Table I."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from functools import partial
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np

from lacoloco.datasets.artifact import Artifact, write_artifact
from lacoloco.datasets.config_values import Length, Rising, Within, Worlds, check_config
from lacoloco.datasets.hardware import describe_machine
from lacoloco.pipelines.errors import StageError
from lacoloco.pipelines.evaluation.episodes import METRICS, play_episodes
from lacoloco.pipelines.evaluation.hardware_shift import hardware_shift, rows_here
from lacoloco.pipelines.evaluation.intervals import over_seeds
from lacoloco.pipelines.evaluation.task_reward import task_reward
from lacoloco.pipelines.policies import Policy, load_policies, task_of
from lacoloco.pipelines.robot import record_of, robot_of
from lacoloco.pipelines.sim.disturbances.config import UNDISTURBED
from lacoloco.pipelines.sim.randomisation import Randomisation
from lacoloco.pipelines.sim.tasks import Task
from lacoloco.pipelines.stage import StageContext, StageResult
from lacoloco.robots.spec import RobotSpec

TEST_SEED, SELECTION_SEED = 1_000_003, 2_000_003
"""Of development: episodes that are reported, and others on which the best seed is chosen. The
recipe was chosen by them.
"""
FRESH_TEST_SEED, FRESH_SELECTION_SEED = 5_000_011, 6_000_011
"""The same of the fresh protocol. Nothing may be chosen by what the first of them gives."""
PROTOCOLS = {
    "development": (TEST_SEED, SELECTION_SEED),
    "fresh": (FRESH_TEST_SEED, FRESH_SELECTION_SEED),
}
FALL_COST_M = 1.0
"""What a share of falls of one costs in the choice of the best seed: as much as a mean error of
one metre.
"""


@dataclass(frozen=True)
class EvalConfig:
    """How much is evaluated.

    Attributes:
        episodes: reported episodes per policy (paper: 4096).
        selection_episodes: further ones, to choose the best of several seeds.
        worlds: how many run at once.
        friction: range of the friction instead of the task's; both ends equal for one value.
        mass_scale: the same of the factor on all masses.
        protocol: which episodes: those of development, or fresh ones that nothing was tuned on.
        shift: "hardware" plays the reported episodes again, each time with one thing as on a real
            robot, and in the end with everything at once.
        shift_rows: only these rows of it; none named: all.
    """

    episodes: Annotated[int, Within(1, 10**7)] = 4096
    selection_episodes: Annotated[int, Within(1, 10**7)] = 1024
    worlds: Worlds = 1024
    friction: Annotated[tuple[float, float], Within(0, 1000, above=True), Rising()] | None = None
    mass_scale: Annotated[tuple[float, float], Within(0, 1000, above=True), Rising()] | None = None
    protocol: Literal["development", "fresh"] = "development"
    shift: Literal["", "hardware"] = ""
    shift_rows: Annotated[tuple[str, ...], Length(0, 100)] = ()

    def randomisation(self, usual: Randomisation) -> Randomisation:
        """The task's, with the ranges given here."""
        given: dict[str, Any] = {"friction": self.friction, "mass_scale": self.mass_scale}
        return replace(usual, **{name: value for name, value in given.items() if value is not None})


PRESETS: dict[str, Callable[[], EvalConfig]] = {
    "smoke": lambda: EvalConfig(episodes=16, selection_episodes=8, worlds=16),
    "laptop": lambda: EvalConfig(),
    "gpu": lambda: EvalConfig(worlds=4096),
    "paper": lambda: EvalConfig(worlds=4096),
    "paper-method": lambda: EvalConfig(),
}


def run(
    config: EvalConfig,
    context: StageContext,
    *,
    policies: Sequence[Path],
    names: Sequence[str] = (),
) -> StageResult:
    """Evaluate high-level artifacts, one row each, and the best of them by episodes that are not
    reported.

    Args:
        config: How much.
        context: Run, device.
        policies: What to evaluate.
        names: Of the rows, one per policy, where methods do not tell them apart; rows of one name
            are seeds of it.

    Raises:
        ArtifactError: an input is missing, damaged, or holds no high level.
        ConfigError: a value that its field does not allow.
        StageError: policies of tasks that cannot be compared, or a shift that cannot be played.
    """
    check_config(config)
    # Before anything begins: what cannot be evaluated leaves nothing, and wastes no evaluation.
    candidates = [_candidate(path, config, context) for path in policies]
    _check(config, context, candidates)
    directory = context.store.begin(context.run, "eval", at_once=True)
    rows: list[dict[str, Any]] = []
    arrays: dict[str, np.ndarray] = {}
    for index, candidate in enumerate(candidates):
        method, seed = candidate.artifact.metadata["method"], candidate.artifact.seed
        context.progress.start(f"eval {method} seed {seed}", config.episodes)
        if candidate.task.has_target:
            row, kept = _row(candidate, config, context)
            arrays |= {f"{index}/{name}": value for name, value in kept.items()}
        else:
            row = _reward_row(candidate, config, context)
        rows.append(row)
        context.progress.stop()
    for row, name in zip(rows if names else [], names, strict=True):
        row["variant"] = name
    best = min(rows, key=_selection)
    metadata: dict[str, Any] = {"rows": rows, "best": best, "summary": summary(rows)}
    metadata["protocol"] = config.protocol
    if config.shift:
        metadata["shift"] = _shift(candidates[0], config, context)
    write_artifact(
        directory.file("artifact.h5"),
        "lacoloco/evaluation",
        arrays,
        metadata=metadata | {"hardware": {"device": context.device, **describe_machine()}},
        config=asdict(config),
        seed=context.seed,
        robot=record_of(candidates[-1].spec),
        parents=list(policies),
        command=context.command,
    )
    return StageResult(directory.complete(), metadata)


@dataclass(frozen=True)
class _Candidate:
    """A policy to evaluate, its robot, and its task as it is evaluated."""

    path: Path
    artifact: Artifact
    policies: Mapping[str, Policy]
    spec: RobotSpec
    task: Task


def _candidate(path: Path, config: EvalConfig, context: StageContext) -> _Candidate:
    artifact, policies = load_policies(path, "low", "high", device=context.device)
    spec = robot_of(artifact, context.progress.say)
    task = task_of(artifact, spec)
    # As noise, disturbances that a policy was trained with are off in evaluation.
    usual = config.randomisation(task.randomisation)
    task = replace(task, randomisation=usual, disturbances=UNDISTURBED)
    return _Candidate(path, artifact, policies, spec, task)


def _check(config: EvalConfig, context: StageContext, candidates: Sequence[_Candidate]) -> None:
    if len({candidate.task.has_target for candidate in candidates}) > 1:
        raise StageError("policies with a target and without one: evaluate them one kind at a time")
    if not config.shift:
        return
    rows_here(config.shift_rows)
    if len(candidates) != 1:
        raise StageError(f"shift={config.shift} is for one policy at a time; name it with --policy")
    if context.device != "cpu":
        raise StageError(f"--device {context.device}: shift={config.shift} runs on the CPU")
    if not candidates[0].task.has_target:
        raise StageError(f"shift={config.shift} counts distances; the policy's task has no target")


def _shift(
    candidate: _Candidate, config: EvalConfig, context: StageContext
) -> list[dict[str, Any]]:
    """The table of the hardware shift, on the reported episodes."""
    return hardware_shift(
        candidate.spec,
        candidate.policies,
        candidate.task,
        rows_here(config.shift_rows),
        episodes=config.episodes,
        worlds=config.worlds,
        seed=PROTOCOLS[config.protocol][0],
        progress=context.progress,
    )


def summary(rows: list[dict[str, Any]]) -> dict[str, dict[str, Any]]:
    """Mean, sample standard deviation and 95 % interval of the mean over seeds of every metric, by
    variant or else by method; one seed has no interval.
    """
    result: dict[str, dict[str, Any]] = {}
    names = [row.get("variant", row["method"]) for row in rows]
    for name in dict.fromkeys(names):
        for metric in (*METRICS, "task_reward"):
            if metric not in rows[0]:
                continue
            values = np.array(
                [row[metric] for row, its in zip(rows, names, strict=True) if its == name]
            )
            entry = result.setdefault(name, {"seeds": len(values)})
            entry[f"{metric}_mean"] = float(values.mean())
            entry[f"{metric}_spread"] = float(values.std(ddof=1)) if len(values) > 1 else 0.0
            entry[f"{metric}_interval"] = over_seeds(values.tolist(), _range(metric))
    return result


def _range(metric: str) -> tuple[float, float]:
    """Where a metric can lie."""
    if metric == "task_reward":
        return -math.inf, math.inf
    return 0.0, 100.0 if metric.endswith("_pct") else math.inf


def _selection(row: dict[str, Any]) -> float:
    """What the best policy has least of, on episodes that are not reported."""
    score = -row["selection_reward"] if "task_reward" in row else row["selection_score_m"]
    return score if math.isfinite(score) else math.inf  # all of its worlds diverged


def _reward_row(candidate: _Candidate, config: EvalConfig, context: StageContext) -> dict[str, Any]:
    """The row of a policy whose task has no target: what the task pays it per second."""
    test_seed, selection_seed = PROTOCOLS[config.protocol]
    play = partial(
        task_reward, candidate.spec, candidate.task, candidate.policies, device=context.device
    )
    reported = play(episodes=config.episodes, seed=test_seed)
    chosen = play(episodes=config.selection_episodes, seed=selection_seed)
    return {
        "method": candidate.artifact.metadata["method"],
        "seed": candidate.artifact.seed,
        "episodes": config.episodes,
        "task": candidate.task.name,
        **reported,
        "selection_reward": chosen["task_reward"],
        "policy": str(candidate.path),
    }


def _row(
    candidate: _Candidate, config: EvalConfig, context: StageContext
) -> tuple[dict[str, Any], dict[str, np.ndarray]]:
    """The row of a policy with targets, and its episodes."""
    play = partial(
        play_episodes,
        candidate.spec,
        candidate.policies,
        worlds=config.worlds,
        device=context.device,
        task=candidate.task,
    )
    test_seed, selection_seed = PROTOCOLS[config.protocol]
    reported = play(config.episodes, seed=test_seed, progress=context.progress)
    selection = play(config.selection_episodes, seed=selection_seed).metrics()
    error, falls = selection["ee_error_mean_m"], selection["falls_pct"]
    return {
        "method": candidate.artifact.metadata["method"],
        "seed": candidate.artifact.seed,
        "episodes": config.episodes,
        **reported.metrics(),
        "intervals": reported.intervals(),
        "diverged": int(reported.diverged.sum()),
        "not_reached": int(reported.not_reached.sum()),
        "no_progress": int(reported.no_progress.sum()),
        "failure_clusters": reported.failure_clusters(),
        "selection_error_m": error,
        "selection_falls_pct": falls,
        "selection_score_m": error + FALL_COST_M * falls / 100.0,
        "policy": str(candidate.path),
    }, reported.arrays()
