"""Stage track: clips -> the same motions as a robot performs them, recorded from a policy that
follows them in simulation.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path

from lacoloco.datasets.clip import load_clips, save_clips
from lacoloco.datasets.motion_library import MotionLibrary
from lacoloco.pipelines.learn.networks import NetworkConfig
from lacoloco.pipelines.learn.ppo import PpoConfig
from lacoloco.pipelines.policies import save_policies
from lacoloco.pipelines.stage import StageContext, StageResult
from lacoloco.pipelines.tracking.recorder import RecordingConfig, record, worlds
from lacoloco.pipelines.tracking.reference_clips import repertoire
from lacoloco.pipelines.tracking.trainer import Shadow, TrackerConfig, TrackerTrainer
from lacoloco.pipelines.training.loop import remove_checkpoints, train
from lacoloco.robots.registry import load_robot

SHOWN = ("reward", "lost_per_1000_steps", "falls_per_1000_steps", "std")


@dataclass(frozen=True)
class TrackConfig:
    """The tracker's training, and what is recorded of it.

    Attributes:
        tracker: the training.
        recording: what is recorded.
        paces: factors on the speed of the clips; each is followed at each of them.
    """

    tracker: TrackerConfig = field(default_factory=TrackerConfig)
    recording: RecordingConfig = field(default_factory=RecordingConfig)
    paces: tuple[float, ...] = (1.0, 0.6)


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
            copies=1, starts=2, stops=2, settle_s=0.0, before_loss_s=0.0, shortest_s=0.1
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
}


def run(config: TrackConfig, context: StageContext, *, motions: Sequence[Path]) -> StageResult:
    """Train a tracker on the clips of some artifacts and record it; the tracker is kept beside the
    clips.

    Raises:
        ArtifactError: the motions are missing or damaged.
        StageError: the tracker never followed any clip for long enough.
    """
    from lacoloco.datasets.artifact import read_header

    spec = load_robot(read_header(motions[0]).robot)
    given = [clip for path in motions for clip in load_clips(path, robot=spec.name)]
    clips = repertoire(spec, given, config.paces)
    library = MotionLibrary(clips, context.device)
    directory = context.store.begin(context.run, "track", resume=context.resume)
    trainer = TrackerTrainer(
        spec, library, config.tracker, seed=context.seed, device=context.device
    )
    metrics = train(
        trainer, trainer.iterations, directory.path, context, "track", SHOWN, config=asdict(config)
    )
    policy = trainer.policy()
    count, references = worlds(clips, config.recording), trainer.shadow.references
    shadow = Shadow(
        spec,
        library,
        references,
        config.tracker,
        count,
        seed=context.seed + 1,
        device=context.device,
    )
    pieces, figures = record(shadow, clips, policy, config.recording, seed=context.seed)
    metrics |= figures
    written = {"spec": spec, "context": context, "config": asdict(config), "metrics": metrics}
    save_policies(directory.file("tracker.h5"), [policy], parents=motions, **written)
    save_clips(
        directory.file("artifact.h5"),
        pieces,
        robot=(spec.name, spec.model_hash()),
        config=asdict(config),
        seed=context.seed,
        parents=motions,
        command=context.command,
        metadata={"metrics": metrics},
    )
    remove_checkpoints(directory.path)
    return StageResult(directory.complete(), metrics)
