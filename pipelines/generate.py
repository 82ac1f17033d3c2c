"""Stage generate: experts perform the synthetic motions, by default 120 clips of walking and 20 of
reaching, 10 s each.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict, replace
from pathlib import Path

from lacoloco.datasets import published
from lacoloco.datasets.artifact import read_header
from lacoloco.datasets.clip import Clip, save_clips
from lacoloco.datasets.work import Work
from lacoloco.pipelines.errors import StageError
from lacoloco.pipelines.generation.assessment import assess, assessed
from lacoloco.pipelines.generation.config import (
    ExpertConfig,
    GenerateConfig,
    reach_expert,
    smoke_expert,
    wide,
)
from lacoloco.pipelines.generation.expert_trainer import ExpertTrainer
from lacoloco.pipelines.generation.recorder import SKILLS, record
from lacoloco.pipelines.policies import Policy, load_policies, save_policies
from lacoloco.pipelines.robot import belongs_to, record_of
from lacoloco.pipelines.stage import StageContext, StageResult
from lacoloco.pipelines.training.loop import train
from lacoloco.robots.registry import load_robot
from lacoloco.robots.spec import RobotSpec

LOG_KEYS = ("reward", "velocity_error", "yaw_error", "target_error", "falls_per_1000_steps", "std")


def laptop() -> GenerateConfig:
    """The paper's clips from experts trained in a few minutes each on two cores."""
    return GenerateConfig()


def smoke() -> GenerateConfig:
    """Seconds; the experts have learned nothing, so only that everything runs is shown."""
    return GenerateConfig(
        smoke_expert(),
        smoke_expert(),
        walk_clips=3,
        reach_clips=2,
        seconds=0.2,
        episodes=4,
        transient_s=0.02,
    )


def gpu() -> GenerateConfig:
    """The paper's clips from experts with thirteen times the laptop's samples each."""
    return GenerateConfig(wide(ExpertConfig(), 330), wide(reach_expert(), 330))


def paper() -> GenerateConfig:
    """The paper's clips from experts with the budgets of its Solo12 experts: 2000 and 7000
    iterations (the original's code).
    """
    return GenerateConfig(wide(ExpertConfig(), 2000), wide(reach_expert(), 7000))


PRESETS: dict[str, Callable[[], GenerateConfig]] = {
    "smoke": smoke,
    "laptop": laptop,
    "gpu": gpu,
    "paper": paper,
    "paper-method": laptop,
}


def run(
    config: GenerateConfig, context: StageContext, *, robot: str, retrain: bool = False
) -> StageResult:
    """Record clips of both experts; train the experts first when the run has none for this robot,
    or if asked to.

    Raises:
        RobotError: Unknown robot.
        StageError: An expert falls too often to record enough clips without a fall.
    """
    spec = load_robot(robot)
    directory = context.begin("generate", work(config, context, robot=robot))
    experts = _experts(config, context, spec, retrain)
    trained, policies = load_policies(experts, *SKILLS, device=context.device)
    clips: list[Clip] = []
    metrics: dict[str, float | None] = assessed(trained.metadata["metrics"])
    for task, count in (("walk", config.walk_clips), ("reach_in_place", config.reach_clips)):
        recorded, measured = record(spec, task, policies[task], count, config, context)
        clips += recorded
        metrics |= measured
    save_clips(
        directory.file("artifact.h5"),
        clips,
        robot=record_of(spec),
        config=asdict(config),
        seed=context.seed,
        parents=[experts],
        command=context.command,
        metadata={"metrics": metrics},
    )
    seconds = sum(clip.duration for clip in clips)
    return StageResult(directory.complete(), {"clips": len(clips), "seconds": seconds, **metrics})


def work(
    config: GenerateConfig, context: StageContext, *, robot: str, retrain: bool = False
) -> Work:
    """What clips, and experts trained for them, are made from; which experts perform is not
    compared.

    Raises:
        RobotError: Unknown robot.
    """
    return context.work(config, record_of(load_robot(robot)))


def _experts(config: GenerateConfig, context: StageContext, spec: RobotSpec, retrain: bool) -> Path:
    """The run's newest experts of this robot, else the published ones, else newly trained ones.

    A resumed call goes on with experts that it began, and takes those that it finished.
    """
    asked = context.work(config, record_of(spec))
    for path in reversed(context.store.all(context.run, "experts")):
        header = read_header(path)
        mine = context.resume and not Work.of(header).differences(asked)
        if mine or (belongs_to(header, spec) and not retrain and not _begun(context, asked)):
            return path
    if not retrain and not _begun(context, asked):
        bundled = published.find(f"{spec.name}-experts")
        if bundled is not None and belongs_to(read_header(bundled), spec):
            context.progress.say(
                f"using the published experts of {spec.name}; --retrain makes them again"
            )
            return bundled
        context.progress.say(
            f"run '{context.run}' has no experts for {spec.name} yet: training them"
        )
    return train_experts(config, context, spec)


def _begun(context: StageContext, asked: Work) -> bool:
    """Whether a resumed call has begun to train experts."""
    left = context.store.partials(context.run, "experts") if context.resume else []
    begun = [Work.read(one.path) for one in left]
    return any(one is not None and not one.differences(asked) for one in begun)


def train_experts(config: GenerateConfig, context: StageContext, spec: RobotSpec) -> Path:
    """Train the walking and the reaching expert and write both into one artifact of the stage
    ``experts``.
    """
    # The version that the user may have chosen is one of generate's.
    mine = replace(context, version="", or_begin=True)
    directory = mine.begin("experts", mine.work(config, record_of(spec)))
    policies: list[Policy] = []
    metrics: dict[str, float | None] = {}
    trained: dict[str, ExpertTrainer] = {}
    for task, expert in (("walk", config.walk), ("reach_in_place", config.reach)):
        trainer = ExpertTrainer(spec, task, expert, seed=context.seed, device=context.device)
        if first := trainer.task.start_from:
            if first not in trained:
                raise StageError(f"task {task!r} starts from {first!r}, which has no expert yet")
            trainer.start_from(trained[first])
        trained[task] = trainer
        last = train(
            trainer, trainer.iterations, directory.path, context, f"expert {task}", LOG_KEYS
        )
        policies.append(trainer.policy())
        metrics |= {f"{task}_seconds": last["seconds"], f"{task}_samples": last["samples"]}
        metrics |= assess(
            spec,
            task,
            policies[-1],
            worlds=config.episodes,
            seconds=config.seconds,
            transient_s=config.transient_s,
            seed=context.seed + 1,
            device=context.device,
        )
    save_policies(
        directory.file("artifact.h5"),
        policies,
        spec=spec,
        context=context,
        config=asdict(config),
        parents=[],
        metrics=metrics,
    )
    return directory.complete()
