"""Stage retarget: motion capture (.bvh) -> clips of the robot.

Each file becomes one clip. A file that cannot be read is reported and left out; what the solver
cannot solve is replaced by the next best, counted and reported.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from lacoloco.datasets.clip import save_clips
from lacoloco.datasets.errors import DatasetError
from lacoloco.datasets.mocap import UpAxis, load_bvh
from lacoloco.datasets.samples import DOG_BVH
from lacoloco.datasets.store import StageDir
from lacoloco.pipelines.errors import StageError
from lacoloco.pipelines.retargeting.clip_problem import ClipWeights
from lacoloco.pipelines.retargeting.report import write_report
from lacoloco.pipelines.retargeting.retargeter import Mode, Retargeted, Retargeter
from lacoloco.pipelines.retargeting.sources import clip_names, find_recordings
from lacoloco.pipelines.stage import StageContext, StageResult
from lacoloco.robots.registry import load_robot

STAGE = "retarget"
SAMPLE_LICENCE = "BSD-3-Clause"


@dataclass(frozen=True)
class RetargetConfig:
    """How recordings are retargeted.

    Attributes:
        mode: "clip" solves all frames together, feet planted where the paws stand; "paper" solves
            the paper's program frame by frame and sets the result on the ground.
        scale: "auto" fits the animal to the robot, a number does so with this factor, "none" leaves
            it in its own size (paper); empty: what suits the mode.
        posture_weight: alpha of the paper, m^2/rad^2; for mode "paper".
        clip: Weights of mode "clip".
        up_axis: Axis of the files that points up.
        unit: Metres per unit of the files.
        skill: Skill of the clips.
        licence: Licence of the files; that of the bundled sample is known.
        pictures: Draw a report of each clip beside the artifact.
    """

    mode: Mode = "clip"
    scale: str = ""
    posture_weight: float = 0.005
    clip: ClipWeights = field(default_factory=ClipWeights)
    up_axis: UpAxis = "y"
    unit: float = 0.01
    skill: str = "dog"
    licence: str = ""
    pictures: bool = True


def laptop() -> RetargetConfig:
    """Clips to learn from."""
    return RetargetConfig()


def smoke() -> RetargetConfig:
    """The same; retargeting is quick as it is."""
    return RetargetConfig()


def paper() -> RetargetConfig:
    """The paper's program: frame by frame, the dog in its own size."""
    return RetargetConfig(mode="paper")


PRESETS: dict[str, Callable[[], RetargetConfig]] = {
    "smoke": smoke,
    "laptop": laptop,
    "paper": paper,
}


def run(
    config: RetargetConfig,
    context: StageContext,
    *,
    robot: str = "solo12",
    sources: Sequence[str | Path] = (),
) -> StageResult:
    """Retarget recordings and write their clips as one artifact.

    Args:
        config: How.
        context: Where.
        robot: Name of the robot.
        sources: Files, folders and patterns; none for the bundled sample.

    Returns:
        The artifact; metrics `clips` (one entry per clip), `skipped` (file and reason of those left
        out), `frames`, and `frames_per_second` of one core.

    Raises:
        StageError: A folder or pattern without files, an impossible scale, or no clip at all.
        RobotError: Unknown robot.
        DatasetError: The only file cannot be used.
    """
    paths = find_recordings(sources or [DOG_BVH])
    spec = load_robot(robot)
    retargeter = Retargeter(spec, config.mode, config.scale, config.posture_weight, config.clip)
    made: list[tuple[Path, Retargeted]] = []
    skipped: list[dict[str, str]] = []
    for path, name in zip(paths, clip_names(paths), strict=True):
        try:
            made.append((path, _one(retargeter, path, name, config, context)))
        except (DatasetError, StageError) as error:
            if len(paths) == 1:
                raise
            skipped.append({"file": str(path), "error": str(error)})
            context.progress.say(f"skipped: {error}")
    if not made:
        raise StageError(
            f"none of {len(paths)} files gave a clip; the first: {skipped[0]['error']}"
        )
    metrics = {
        "clips": [result.figures() for _, result in made],
        "skipped": skipped,
        "frames": retargeter.frames,
        "frames_per_second": retargeter.frames_per_second,
    }
    directory = context.store.begin(context.run, STAGE)
    if config.pictures:
        _draw(directory, [result for _, result in made], metrics["clips"])
    save_clips(
        directory.file("artifact.h5"),
        [result.clip for _, result in made],
        robot=(spec.name, spec.model_hash()),
        config=asdict(config),
        seed=context.seed,
        parents=[path for path, _ in made],
        command=context.command,
        metadata={"metrics": metrics},
    )
    return StageResult(directory.complete(), metrics)


def _draw(
    directory: StageDir, made: Sequence[Retargeted], figures: Sequence[Mapping[str, Any]]
) -> None:
    """One picture per clip: `report.png`, or several in `reports/`."""
    for result, row in zip(made, figures, strict=True):
        name = "report.png" if len(made) == 1 else f"reports/{result.clip.name}.png"
        path = directory.file(name)
        path.parent.mkdir(parents=True, exist_ok=True)
        write_report(path, result.assessment, row)


def _one(
    retargeter: Retargeter, path: Path, name: str, config: RetargetConfig, context: StageContext
) -> Retargeted:
    """One file as a clip; shows its progress."""
    mocap = load_bvh(path, up_axis=config.up_axis, scale=config.unit)
    if mocap.frames < 2:
        raise DatasetError(f"{path}: has one frame; a motion needs at least two")
    known = SAMPLE_LICENCE if path.resolve() == DOG_BVH.resolve() else "unknown"
    context.progress.start(f"{STAGE} {name}", mocap.frames)
    try:
        return retargeter.clip(
            mocap,
            name,
            on_frame=context.progress.advance,
            say=lambda line: context.progress.say(f"{name}: {line}"),
            skill=config.skill,
            source=path.name,
            licence=config.licence or known,
        )
    finally:
        context.progress.stop()
