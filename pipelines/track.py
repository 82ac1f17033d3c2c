"""Stage track: clips -> the same motions of a simulated robot, recorded from a policy that follows
the clips.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Annotated

from lacoloco.datasets.clip import load_clips, save_clips
from lacoloco.datasets.config_values import Length, Within
from lacoloco.datasets.motion_library import MotionLibrary
from lacoloco.datasets.work import Work
from lacoloco.pipelines.learn.networks import NetworkConfig
from lacoloco.pipelines.learn.ppo import PpoConfig
from lacoloco.pipelines.policies import save_policies
from lacoloco.pipelines.robot import record_of, robot_of_all
from lacoloco.pipelines.stage import StageContext, StageResult
from lacoloco.pipelines.tracking.config import RecordingConfig, TrackerConfig
from lacoloco.pipelines.tracking.env import TrackingEnv
from lacoloco.pipelines.tracking.recorder import record
from lacoloco.pipelines.tracking.reference_clips import reference_clips
from lacoloco.pipelines.tracking.rollout_plan import num_rollouts
from lacoloco.pipelines.tracking.trainer import TrackerTrainer
from lacoloco.pipelines.training.loop import train
from lacoloco.robots.spec import RobotSpec

LOG_KEYS = ("reward", "early_terminations_per_1000_steps", "falls_per_1000_steps", "std")


@dataclass(frozen=True)
class TrackConfig:
    """The tracker's training, and what is recorded of it.

    Attributes:
        tracker: The training.
        recording: What is recorded.
        speed_factors: Factors on the speed of the clips; every clip is followed at each of them.
    """

    tracker: TrackerConfig = field(default_factory=TrackerConfig)
    recording: RecordingConfig = field(default_factory=RecordingConfig)
    speed_factors: Annotated[tuple[float, ...], Length(1, 100), Within(0.01, 100)] = (1.0, 0.6)


def laptop() -> TrackConfig:
    """Some minutes on two cores."""
    return TrackConfig()


def smoke() -> TrackConfig:
    """Seconds; nothing has been learned, so only that everything runs is shown."""
    tracker = TrackerConfig(
        worlds=16,
        samples=16 * 4 * 2,
        ppo=PpoConfig(horizon=4, epochs=1, minibatches=2),
        networks=NetworkConfig(actor=(32,), critic=(32,)),
    )
    return TrackConfig(
        tracker,
        RecordingConfig(
            copies=1,
            starts=2,
            stops=2,
            transient_s=0.0,
            before_termination_s=0.0,
            min_segment_s=0.1,
        ),
    )


def gpu() -> TrackConfig:
    """The laptop's recipe on a GPU's width, with ten times the samples."""
    base = TrackerConfig()
    return TrackConfig(
        replace(base, worlds=4096, samples=30_000_000, ppo=replace(base.ppo, minibatches=8))
    )


PRESETS: dict[str, Callable[[], TrackConfig]] = {
    "smoke": smoke,
    "laptop": laptop,
    "gpu": gpu,
    "paper": gpu,
    "paper-method": laptop,
}


def run(config: TrackConfig, context: StageContext, *, motions: Sequence[Path]) -> StageResult:
    """Train a tracker on the clips of some artifacts and record it.

    The tracker is kept beside the clips, as ``tracker.h5``.

    Raises:
        ArtifactError: The motions are missing or damaged.
        StageError: The tracker never followed any clip for long enough.
    """
    spec = robot_of_all(motions, context.progress.say)
    given = [clip for path in motions for clip in load_clips(path, robot=spec.name)]
    clips = reference_clips(spec, given, config.speed_factors)
    library = MotionLibrary(clips, context.device)
    directory = context.begin("track", work(config, context, motions=motions, robot=spec))
    trainer = TrackerTrainer(
        spec, library, config.tracker, seed=context.seed, device=context.device
    )
    metrics = train(
        trainer,
        trainer.iterations,
        directory.path,
        context,
        "track",
        LOG_KEYS,
        config=asdict(config),
    )
    policy = trainer.policy()
    env = TrackingEnv(
        spec,
        library,
        trainer.env.reference,
        config.tracker,
        num_rollouts(len(clips), config.recording),
        seed=context.seed + 1,
        device=context.device,
    )
    segments, recorded = record(env, clips, policy, config.recording, seed=context.seed)
    metrics |= recorded
    tracker = directory.file("tracker.h5")
    tracker.unlink(missing_ok=True)  # of a call that was killed after it
    save_policies(
        tracker,
        [policy],
        spec=spec,
        context=context,
        config=asdict(config),
        parents=motions,
        metrics=metrics,
    )
    save_clips(
        directory.file("artifact.h5"),
        segments,
        robot=record_of(spec),
        config=asdict(config),
        seed=context.seed,
        parents=motions,
        command=context.command,
        metadata={"metrics": metrics},
    )
    return StageResult(directory.complete(), metrics)


def work(
    config: TrackConfig,
    context: StageContext,
    *,
    motions: Sequence[Path],
    robot: RobotSpec | None = None,
) -> Work:
    """What the training and its recording are made from.

    Raises:
        StageError: The artifacts hold clips of different robots.
        ArtifactError: An input is missing or damaged.
    """
    return context.work(config, record_of(robot or robot_of_all(motions)), motions)
