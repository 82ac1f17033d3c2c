"""Stage train-high: a low-level policy and a task -> a high-level policy that steers it by latents
(paper section IV).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict, replace
from functools import partial
from pathlib import Path
from typing import Any

from lacoloco.datasets.artifact import Header, read_header
from lacoloco.datasets.errors import ArtifactError
from lacoloco.datasets.work import Work
from lacoloco.pipelines.errors import StageError
from lacoloco.pipelines.evaluation.episodes import play_episodes
from lacoloco.pipelines.evaluation.task_reward import task_reward
from lacoloco.pipelines.high_level.config import (
    CONTACT_FORCE_PENALTY,
    SkillDynamicsConfig,
    TrainHighConfig,
)
from lacoloco.pipelines.high_level.paper_method import paper_method
from lacoloco.pipelines.high_level.trainer import HighTrainer
from lacoloco.pipelines.learn import parallel
from lacoloco.pipelines.learn.networks import NetworkConfig
from lacoloco.pipelines.learn.ppo import PpoConfig
from lacoloco.pipelines.policies import Policy, load_policies, save_policies
from lacoloco.pipelines.robot import record_of, robot_of
from lacoloco.pipelines.sim.commands import TargetCommand, VelocityCommand
from lacoloco.pipelines.sim.hierarchical_env import HOLD_STEPS
from lacoloco.pipelines.sim.observation import Measured, Observation, observation_of
from lacoloco.pipelines.sim.tasks import Task, load_task, load_task_file
from lacoloco.pipelines.stage import StageContext, StageResult
from lacoloco.pipelines.training.diagnostics import high_level_warnings
from lacoloco.pipelines.training.train_stage import TrainStage
from lacoloco.robots.spec import RobotSpec

LOG_KEYS = ("reward", "final_error", "falls_per_episode", "std")


def laptop() -> TrainHighConfig:
    """A quarter of an hour on two cores."""
    return TrainHighConfig()


def smoke() -> TrainHighConfig:
    """Seconds; only to see that everything runs."""
    return TrainHighConfig(
        worlds=16,
        decisions=16 * 4 * 2,
        skill_dynamics=SkillDynamicsConfig(
            rounds=1, decisions=6, hold=(4, 5), model_steps=4, policy_steps=4, batch=64
        ),
        ppo=PpoConfig(horizon=4, epochs=1, minibatches=2),
        networks=NetworkConfig(actor=(32,), critic=(32,)),
    )


def gpu() -> TrainHighConfig:
    """The laptop's recipe on a GPU's width, with ten times the decisions."""
    base = laptop()
    return replace(base, worlds=4096, decisions=40_000_000, ppo=replace(base.ppo, minibatches=8))


def paper() -> TrainHighConfig:
    """The paper's budget: 2000 iterations of 32 decisions in 4096 worlds, 1310 M steps."""
    base = gpu()
    return replace(
        base, decisions=2000 * 32 * base.worlds, ppo=replace(base.ppo, horizon=32, epochs=6)
    )


PRESETS: dict[str, Callable[[], TrainHighConfig]] = {
    "smoke": smoke,
    "laptop": laptop,
    "gpu": gpu,
    "paper": paper,
    "paper-method": paper_method,
}


def run(
    config: TrainHighConfig, context: StageContext, *, low: Path, task: Path | None = None
) -> StageResult:
    """Train one seed over the low level in artifact ``low``; the result holds both levels.

    Args:
        config: How to train.
        context: Where to write, and the seed.
        low: The artifact of a low level.
        task: A file with the task to train on; the robot's reach task without it.

    Raises:
        ArtifactError: ``low`` is missing, damaged, or holds no low level.
        RobotError: The file of the task is missing or wrong.
    """
    artifact, policies = load_policies(low, "low", device=context.device)
    spec = robot_of(artifact, context.progress.say)
    method = artifact.metadata["method"]
    config = resolved(config, artifact)
    _check_observation(config, policies["low"], low)
    mine = shared(config)

    rules = load_task_file(spec, task) if task else load_task(spec, "reach")

    def make_trainer() -> HighTrainer:
        seed = parallel.own_seed(context.seed)
        return HighTrainer(
            spec, policies["low"], mine, seed=seed, device=context.device, task=rules
        )

    def save(trainer: HighTrainer, path: Path, metrics: dict[str, Any]) -> dict[str, Any]:
        high = trainer.policy()
        metrics |= _before_and_after(spec, rules, policies["low"], high, config, context)
        save_policies(
            path,
            [policies["low"], high],
            spec=spec,
            context=context,
            config=asdict(config),
            parents=[low],
            metrics=metrics,
            metadata={"method": method, "hold_steps": HOLD_STEPS, **_carried(task)},
        )
        return metrics

    asked = work(config, context, low=low, task=task)
    moves = isinstance(rules.command, TargetCommand | VelocityCommand)
    warnings = partial(high_level_warnings, walk_speed=spec.skills.walk_speed if moves else 0.0)
    stage = TrainStage("train-high", method, config, context, asked, LOG_KEYS, warnings)
    pretraining = "trying latents, and making a first policy from what they do"
    begun = mine.skill_dynamics.rounds > 0 and rules.has_target
    return stage.run(make_trainer, save, pretraining if begun else None)


def work(
    config: TrainHighConfig, context: StageContext, *, low: Path, task: Path | None = None
) -> Work:
    """What the training is made from.

    Raises:
        ArtifactError: ``low`` is missing or damaged.
        RobotError: Its robot is not to be found.
    """
    header = read_header(low)
    text = _carried(task)["task"]["text"] if task else ""
    return context.work(resolved(config, header), record_of(robot_of(header)), [low], text)


def resolved(config: TrainHighConfig, low: Header) -> TrainHighConfig:
    """The config with the defaults that follow from its low level."""
    usual: Measured = "onboard" if _observation_of(low).onboard else "full"
    config = replace(config, observation=config.observation.resolved(usual))
    return with_contact_force_penalty(config, was_constrained(low))


def _observation_of(low: Header) -> Observation:
    """What the low level in an artifact observes.

    Raises:
        ArtifactError: It does not say.
    """
    try:
        return observation_of(low.metadata["heads"]["low"]["layout"])
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise ArtifactError(f"{low.path}: holds no low level; name another artifact") from error


def _check_observation(config: TrainHighConfig, low: Policy, path: Path) -> None:
    if config.observation.measured == "onboard" and not low.head.observation.onboard:
        raise StageError(
            f"{path}: this low level observes height and linear velocity of the base; train one"
            " with `lacoloco train-low --observe onboard`, or leave out --observe"
        )


def was_constrained(low: Header) -> bool:
    """Whether the low level in an artifact was trained with the constraint on contact forces.

    An artifact of both levels holds the high level's config; its method tells of the low level.
    """
    if "cat" in low.config:
        return bool(low.config["cat"])
    return str(low.metadata["method"]).endswith("-cat")


def with_contact_force_penalty(config: TrainHighConfig, constrained: bool) -> TrainHighConfig:
    """The config with its own penalty on contact forces, or the default over its low level."""
    if config.contact_force_penalty is not None:
        return config
    penalty = CONTACT_FORCE_PENALTY if constrained else 0.0
    return replace(config, contact_force_penalty=penalty)


def shared(config: TrainHighConfig) -> TrainHighConfig:
    """What one of several processes does of it: its part of the worlds and the decisions.

    Raises:
        StageError: the worlds cannot be shared equally.
    """
    try:
        worlds = parallel.share(config.worlds)
    except ValueError as error:
        raise StageError(f"{error}; --set worlds to a multiple") from error
    return replace(config, worlds=worlds, decisions=config.decisions // parallel.size())


def _carried(task: Path | None) -> dict[str, dict[str, str]]:
    """What an artifact keeps of a task file: its name and its text."""
    return {"task": {"file": task.name, "text": task.read_text()}} if task else {}


def _before_and_after(
    spec: RobotSpec,
    task: Task,
    low: Policy,
    high: Policy,
    config: TrainHighConfig,
    context: StageContext,
) -> dict[str, float]:
    """Mean final end-effector error [m], or mean reward per second where the task has no target,
    with random latents and with the trained high level, on the same episodes.
    """
    episodes, seed = min(256, config.worlds), context.seed + 77
    metrics = {}
    for name, policies in (("untrained", {"low": low}), ("trained", {"low": low, "high": high})):
        if task.has_target:
            played = play_episodes(
                spec,
                policies,
                episodes,
                worlds=episodes,
                seed=seed,
                device=context.device,
                task=task,
            )
            metrics[f"{name}_error"] = played.metrics()["ee_error_mean_m"]
        else:
            paid = task_reward(
                spec, task, policies, episodes=episodes, seed=seed, device=context.device
            )
            metrics[f"{name}_reward"] = paid["task_reward"]
    return metrics
