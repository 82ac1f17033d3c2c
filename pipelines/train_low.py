"""Stage train-low: motions -> a low-level policy steered by latents (ASE, with a GAN or DRAIL
discriminator, with or without CaT).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

from lacoloco.datasets import published
from lacoloco.datasets.artifact import read_header
from lacoloco.datasets.clip import Clip, load_clips
from lacoloco.datasets.hashing import hash_file
from lacoloco.datasets.motion_library import MotionLibrary
from lacoloco.datasets.work import Work
from lacoloco.pipelines.errors import StageError
from lacoloco.pipelines.learn import parallel
from lacoloco.pipelines.learn.ase import AseConfig
from lacoloco.pipelines.learn.networks import NetworkConfig
from lacoloco.pipelines.learn.ppo import PpoConfig
from lacoloco.pipelines.low_level.config import TrainLowConfig
from lacoloco.pipelines.low_level.paper_method import paper_method
from lacoloco.pipelines.low_level.trainer import LowTrainer
from lacoloco.pipelines.policies import Policy, load_policies, save_policies
from lacoloco.pipelines.robot import Say, record_of, robot_of_all
from lacoloco.pipelines.stage import StageContext, StageResult
from lacoloco.pipelines.training.diagnostics import low_level_warnings
from lacoloco.pipelines.training.train_stage import TrainStage
from lacoloco.robots.spec import RobotSpec

ROUNDS_OF_A_GAIT = 7
"""Rounds of questions to the experts of a robot that does not stand by itself: falls where they are
asked go from 5.8 to 0.3 per 1000 steps (``learn/LOG.md``).
"""
LOG_KEYS = (
    "imitation_reward",
    "encoder_cosine",
    "agent_accuracy",
    "speed",
    "falls_per_1000_steps",
    "coverage_walk",
    "coverage_reach",
    "coverage_cells",
)


def laptop() -> TrainLowConfig:
    """A quarter of an hour on two cores."""
    return TrainLowConfig()


def smoke() -> TrainLowConfig:
    """Seconds; only to see that everything runs."""
    return TrainLowConfig(
        worlds=16,
        samples=16 * 8 * 3,
        ppo=PpoConfig(horizon=8, epochs=1, minibatches=2),
        networks=NetworkConfig(actor=(32,), critic=(32,)),
        bc_steps=4,
        expert_rounds=0,
        coverage_every=0,
        coverage_latents=16,
        ase=AseConfig(updates=2, batch=64, replay_capacity=256),
    )


def gpu() -> TrainLowConfig:
    """The laptop's recipe on a GPU's width: eight times the worlds, seven times the samples,
    batches to match.
    """
    base = laptop()
    return replace(
        base,
        worlds=4096,
        samples=40_000_000,
        ppo=replace(base.ppo, horizon=32, minibatches=8),
        ase=replace(base.ase, batch=4096, updates=8),
    )


def paper() -> TrainLowConfig:
    """The paper's budget, 7000 iterations of 32 steps in 4096 worlds, and its ramp of the
    constraint.
    """
    base = gpu()
    return replace(
        base,
        samples=7000 * 32 * base.worlds,
        cat_ramp=(5 / 7, 1.0),
        ppo=replace(base.ppo, epochs=6),
    )


def expert_rounds(config: TrainLowConfig, clips: Sequence[Clip], spec: RobotSpec) -> int:
    """Rounds of questions to the experts: what the config says, or what the robot needs."""
    if config.expert_rounds is not None:
        return config.expert_rounds
    commanded = any(clip.command is not None for clip in clips)
    return ROUNDS_OF_A_GAIT if spec.gait is not None and commanded and config.bc_steps else 0


PRESETS: dict[str, Callable[[], TrainLowConfig]] = {
    "smoke": smoke,
    "laptop": laptop,
    "gpu": gpu,
    "paper": paper,
    "paper-method": paper_method,
}


def run(config: TrainLowConfig, context: StageContext, *, motions: Sequence[Path]) -> StageResult:
    """Train one seed on the clips of one or more motion artifacts and write the policy.

    Raises:
        StageError: the artifacts hold clips of different robots.
        ArtifactError: an input is missing or damaged.
    """
    clips, spec = load_motions(motions, context.progress.say)
    config = resolved(config)
    mine = replace(shared(config), expert_rounds=expert_rounds(config, clips, spec))
    shares = dict(config.skill_shares)
    library = MotionLibrary(
        clips,
        context.device,
        weighting="skill" if shares else "duration",
        skill_shares=shares or None,
    )
    method = f"{config.ase.discriminator}{'-cat' if config.cat else ''}"

    experts = experts_of(motions, context) if mine.expert_rounds else None

    def make_trainer() -> LowTrainer:
        seed = parallel.own_seed(context.seed)
        return LowTrainer(spec, library, mine, seed=seed, device=context.device, experts=experts)

    def save(trainer: LowTrainer, path: Path, metrics: dict[str, Any]) -> dict[str, Any]:
        metrics |= trainer.closing_metrics()
        save_policies(
            path,
            [trainer.policy()],
            spec=spec,
            context=context,
            config=asdict(config),
            parents=list(motions),
            metrics=metrics,
            metadata={"method": method},
        )
        return metrics

    asked = work(config, context, motions=motions, robot=spec)
    stage = TrainStage("train-low", method, config, context, asked, LOG_KEYS, low_level_warnings)
    pretraining = "inferring the clips' actions and fitting the first policy to them"
    return stage.run(make_trainer, save, pretraining if config.bc_steps else None)


def experts_of(motions: Sequence[Path], context: StageContext) -> dict[str, Policy]:
    """Task -> the policy that performed its clips: those that the motions were recorded of.

    Raises:
        StageError: They are neither in this run nor published.
        ArtifactError: An artifact is damaged.
    """
    hashes = {parent.sha256 for path in motions for parent in read_header(path).parents}
    own = [path for path in context.store.all(context.run, "experts") if hash_file(path) in hashes]
    copies = [published.find_copy(sha256) for sha256 in sorted(hashes)]
    for path in (*reversed(own), *copies):
        if path is not None:
            return load_policies(path, device=context.device)[1]
    raise StageError(
        "expert_rounds needs the experts that performed the motions; they are neither in run "
        f"{context.run!r} nor published: lacoloco generate in this run, or --set expert_rounds=0"
    )


def work(
    config: TrainLowConfig,
    context: StageContext,
    *,
    motions: Sequence[Path],
    robot: RobotSpec | None = None,
) -> Work:
    """What the training is made from.

    Raises:
        StageError: the artifacts hold clips of different robots.
        ArtifactError: an input is missing or damaged.
    """
    return context.work(resolved(config), record_of(robot or robot_of_all(motions)), motions)


def resolved(config: TrainLowConfig) -> TrainLowConfig:
    """The config with the defaults that follow from what is measured."""
    return replace(config, observation=config.observation.resolved())


def shared(config: TrainLowConfig) -> TrainLowConfig:
    """What one of several processes does of it: its part of the worlds, the samples and each batch.

    Raises:
        StageError: the worlds or the batches cannot be shared equally.
    """
    ase = config.ase
    try:
        batch, capacity = parallel.share(ase.batch), parallel.share(ase.replay_capacity)
        worlds = parallel.share(config.worlds)
    except ValueError as error:
        raise StageError(
            f"{error}; --set worlds, ase.batch and ase.replay_capacity to multiples"
        ) from error
    return replace(
        config,
        worlds=worlds,
        samples=config.samples // parallel.size(),
        ase=replace(ase, batch=batch, replay_capacity=capacity),
    )


def load_motions(paths: Sequence[Path], say: Say | None = None) -> tuple[Sequence[Clip], RobotSpec]:
    """All clips of several motion artifacts, those of a single one as they are stored; their robot.

    Raises:
        StageError: no artifact, or artifacts of different robots or versions of one.
    """
    spec = robot_of_all(paths, say)
    sets = [load_clips(path, robot=spec.name) for path in paths]
    return sets[0] if len(sets) == 1 else [clip for clips in sets for clip in clips], spec
