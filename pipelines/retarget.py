"""Stage retarget: motion capture (.bvh) -> clips of the robot.

Each file becomes one clip, or one in each of several variants. A file that cannot be used is
reported and left out; what the solver cannot solve is replaced by the next best, counted and
reported. Clips that the run has already are taken over.
"""

from __future__ import annotations

import shutil
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

from lacoloco.datasets.clip import save_clips
from lacoloco.datasets.errors import ArtifactError, DatasetError
from lacoloco.datasets.robot_record import RobotRecord
from lacoloco.datasets.store import StageDir
from lacoloco.pipelines.errors import StageError
from lacoloco.pipelines.retargeting.batch import retarget_all
from lacoloco.pipelines.retargeting.cache import (
    FinishedClip,
    clip_keys,
    earlier_clips,
    finished_clips,
    known_clips,
    own_clips,
)
from lacoloco.pipelines.retargeting.config import RetargetConfig
from lacoloco.pipelines.retargeting.mocap.selection import load_selection
from lacoloco.pipelines.retargeting.mocap.skeleton_maps import sample_for
from lacoloco.pipelines.retargeting.mocap.sources import clip_names, find_recordings
from lacoloco.pipelines.retargeting.worker import Task, Worker, clip_path, picture_path
from lacoloco.pipelines.robot import record_of
from lacoloco.pipelines.stage import StageContext, StageResult
from lacoloco.robots.registry import load_robot

STAGE = "retarget"


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
    "gpu": laptop,  # once per data set, on the CPU
    "paper": paper,
    "paper-method": laptop,
}


def run(
    config: RetargetConfig,
    context: StageContext,
    *,
    robot: str,
    sources: Sequence[str | Path] = (),
    jobs: int = 0,
    force: bool = False,
) -> StageResult:
    """Retarget recordings and write their clips as one artifact.

    Args:
        config: How, and which part of them.
        context: Where.
        robot: The robot, by name or by the path of its folder.
        sources: Files, folders and patterns; none for the bundled sample of such a body.
        jobs: Number of processes; 0 for that of the cores.
        force: Also make the clips that the run has already.

    Returns:
        The artifact, an earlier one where that has all there is to make; metrics `clips` (one entry
        per clip), `skipped` (file and reason of those left out), `absent` (selected, but not among
        the files), `kept` (how many clips were there already), `frames`, and `frames_per_second` of
        one core.

    Raises:
        StageError: A folder or pattern without files, an impossible option, or no clip at all.
        RobotError: Unknown robot.
        DatasetError: The only file cannot be used.
    """
    config.check()
    sample = sample_for(load_robot(robot).name, config.maps())
    tasks, absent = _tasks(config, sources or [sample])
    worker = Worker(config, robot)
    keys, failures = _keys(worker, tasks)
    if not keys:
        _nothing(tasks, failures)
    record = record_of(load_robot(robot))
    before = context.store.last_run()
    directory = context.begin(STAGE, context.work(config, record))
    # A version that goes on takes what it made itself in any case.
    candidates = own_clips(directory.path)
    if not force:
        candidates += known_clips(context.store, context.run, STAGE)
    earlier = earlier_clips(candidates, set(keys.values()))
    todo = [task for task in tasks if task in keys and keys[task] not in earlier]
    for task, outcome in retarget_all(
        worker, config, robot, todo, directory.path, jobs, context.progress
    ):
        if isinstance(outcome, (DatasetError, StageError)):
            failures[task] = outcome
            continue
        for warning in outcome:
            context.progress.say(f"{task.name}: {warning}")
    _check_unchanged(worker, keys, failures)
    made = _collect(tasks, keys, failures, earlier, directory)
    if not made:
        directory.discard()
        context.store.use(before or context.run)  # the next verb has nothing to take here
        _nothing(tasks, failures)
    skipped = [{"file": str(task.path), "error": str(e)} for task, e in failures.items()]
    metrics = _metrics(made, skipped, absent, kept=sum(p.key in earlier for _, p in made))
    for entry in skipped:
        context.progress.say(f"skipped: {entry['error']}")
    newest = context.store.all(context.run, STAGE)[-1:]
    if not force and newest and _holds(newest[0], made):
        directory.discard()
        return StageResult(newest[0], metrics)
    _finish(directory, config, context, record, made, metrics)
    return StageResult(directory.complete(), metrics)


def _tasks(config: RetargetConfig, sources: Sequence[str | Path]) -> tuple[list[Task], list[str]]:
    """What is to be done, and the names that a selection misses."""
    files, absent = _files(config, find_recordings(sources))
    return [
        replace(task, name=task.name + suffix, mirror=mirror, bend=bend)
        for suffix, mirror, bend in config.variants()
        for task in files
    ], absent


def _files(config: RetargetConfig, paths: list[Path]) -> tuple[list[Task], list[str]]:
    if not config.select:
        names = clip_names(paths)
        return [Task(path, name) for path, name in zip(paths, names, strict=True)], []
    selection = load_selection(config.select)
    chosen = selection.chosen(paths)
    if not chosen:
        raise StageError(
            f"--select {config.select}: none of its {len(selection.trims)} recordings is among"
            f" {len(paths)} files; name the folder that has them"
        )
    return [Task(path, path.stem, trim) for path, trim in chosen], selection.absent(paths)


def _keys(
    worker: Worker, tasks: Sequence[Task]
) -> tuple[dict[Task, str], dict[Task, DatasetError | StageError]]:
    keys: dict[Task, str] = {}
    failures: dict[Task, DatasetError | StageError] = {}
    for task in tasks:
        try:
            keys[task] = worker.key(task)
        except DatasetError as error:
            failures[task] = error
    return keys, failures


def _check_unchanged(
    worker: Worker, keys: Mapping[Task, str], failures: Mapping[Task, Exception]
) -> None:
    """Refuse to write clips beside the hash of a file that they are not of."""
    now = _keys(worker, [task for task in keys if task not in failures])
    for task, error in now[1].items():
        raise StageError(f"{task.path}: is gone since it was retargeted: {error}") from error
    for task, key in now[0].items():
        if keys[task] != key:
            raise StageError(
                f"{task.path}: has changed since the call began; give the same command again, the"
                " clips of the other files are kept"
            )


def _collect(
    tasks: Sequence[Task],
    keys: Mapping[Task, str],
    failures: Mapping[Task, Exception],
    earlier: Mapping[str, FinishedClip],
    directory: StageDir,
) -> list[tuple[Task, FinishedClip]]:
    """The clips that there are now, in the order of their files."""
    made = []
    for task in tasks:
        if task in failures:
            continue
        finished = earlier.get(keys[task])
        if finished is None:
            (finished,) = finished_clips(clip_path(directory.path, keys[task]))
        made.append((task, finished))
    return made


def _nothing(tasks: Sequence[Task], failures: Mapping[Task, DatasetError | StageError]) -> None:
    first = next(iter(failures.values()))
    if len(tasks) == 1:
        raise first
    raise StageError(f"none of {len(tasks)} files gave a clip; the first: {first}")


def _metrics(
    made: Sequence[tuple[Task, FinishedClip]],
    skipped: list[dict[str, str]],
    absent: list[str],
    kept: int,
) -> dict[str, Any]:
    clips = [finished.metrics for _, finished in made]
    seconds = sum(p.clip.duration / p.metrics["times_real_time"] for _, p in made)
    frames = sum(metrics["frames"] for metrics in clips)
    return {
        "clips": clips,
        "skipped": skipped,
        "absent": absent,
        "kept": kept,
        "frames": frames,
        "frames_per_second": frames / max(seconds, 1e-9),
    }


def _holds(artifact: Path, made: Sequence[tuple[Task, FinishedClip]]) -> bool:
    """Whether an artifact has these clips and no others."""
    try:
        return clip_keys(artifact) == [finished.key for _, finished in made]
    except ArtifactError:
        return False


def _finish(
    directory: StageDir,
    config: RetargetConfig,
    context: StageContext,
    robot: RobotRecord,
    made: Sequence[tuple[Task, FinishedClip]],
    metrics: Mapping[str, Any],
) -> None:
    """Put clips and pictures together."""
    for _, finished in made:
        picture = picture_path(directory.path, finished.clip.name)
        if finished.picture is not None and finished.picture != picture:
            picture.parent.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(finished.picture, picture)
    if len(made) == 1 and (picture := picture_path(directory.path, made[0][1].clip.name)).is_file():
        picture.rename(directory.file("report.png"))
        shutil.rmtree(directory.file("reports"))
    save_clips(
        directory.file("artifact.h5"),
        [finished.clip for _, finished in made],
        robot=robot,
        config=asdict(config),
        seed=context.seed,
        parents=[task.path for task, _ in made],
        command=context.command,
        metadata={"metrics": dict(metrics)},
    )
