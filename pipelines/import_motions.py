"""Stage import: motions of a robot as other programs store them -> clips.

Columns are found by name, orientation and rate are brought to ours, the feet are put on the ground
and their contacts found. What a file does not say is asked for, never guessed.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from lacoloco.datasets.clip import save_clips
from lacoloco.datasets.errors import DatasetError
from lacoloco.datasets.foreign.reading import READERS
from lacoloco.pipelines.errors import StageError
from lacoloco.pipelines.foreign_motions.config import ImportConfig
from lacoloco.pipelines.foreign_motions.convert import Converted, convert
from lacoloco.pipelines.robot import record_of
from lacoloco.pipelines.stage import StageContext, StageResult
from lacoloco.robots.registry import load_robot

STAGE = "import"
PRESETS: dict[str, Callable[[], ImportConfig]] = dict.fromkeys(
    ("smoke", "laptop", "gpu", "paper", "paper-method"), ImportConfig
)


def run(
    config: ImportConfig, context: StageContext, *, robot: str, sources: Sequence[str | Path]
) -> StageResult:
    """Import files as one artifact of clips.

    Args:
        config: What the files do not say, and how they become clips.
        context: Where.
        robot: The robot whose motions they are, by name or by the path of its folder.
        sources: Files, or folders of them.

    Returns:
        The artifact; metrics `clips` (an entry per clip: `name`, `kind`, `frames`, `seconds`,
        `source_fps`, `quaternion`, `lifted_m`, `stance_share`, `left_out`), `remarks` and
        `skipped` (file and reason).

    Raises:
        StageError: No file, or none that gave a clip.
        DatasetError: The only file cannot be used.
        RobotError: Unknown robot.
    """
    spec = load_robot(robot)
    files = find_files(sources)
    made: list[Converted] = []
    skipped: list[dict[str, str]] = []
    context.progress.start("import", len(files))
    for count, file in enumerate(files, 1):
        try:
            made.append(convert(spec, file, config, _free_name(file, made)))
        except (DatasetError, StageError) as error:
            if len(files) == 1:
                raise
            skipped.append({"file": str(file), "error": str(error)})
        context.progress.advance(count)
    if not made:
        raise StageError(
            f"none of {len(files)} files gave a clip; the first: {skipped[0]['error']}"
        )
    remarks = [remark for one in made for remark in one.remarks]
    for line in (*remarks, *(f"skipped: {entry['error']}" for entry in skipped)):
        context.progress.say(line)
    metrics: dict[str, Any] = {
        "clips": [one.metrics for one in made],
        "remarks": remarks,
        "skipped": skipped,
    }
    record = record_of(spec)
    directory = context.begin(STAGE, context.work(config, record, [one.file for one in made]))
    save_clips(
        directory.file("artifact.h5"),
        [one.clip for one in made],
        robot=record,
        config=asdict(config),
        parents=[one.file for one in made],
        command=context.command,
        metadata={"metrics": metrics},
    )
    return StageResult(directory.complete(), metrics)


def find_files(sources: Sequence[str | Path]) -> list[Path]:
    """The files that are named, and those in named folders that end as motions do, in order.

    Raises:
        StageError: A folder without any, or nothing named.
    """
    files: list[Path] = []
    for source in map(Path, sources):
        if not source.is_dir():
            files.append(source)
            continue
        inside = sorted(file for file in source.rglob("*") if file.suffix.lower() in READERS)
        if not inside:
            raise StageError(f"{source}: no file in it ends in {', '.join(READERS)}")
        files += inside
    if not files:
        raise StageError(f"name a file that ends in {', '.join(READERS)}, or a folder of them")
    return files


def _free_name(file: Path, made: Sequence[Converted]) -> str:
    """Name of the clip: that of the file, with its folder where the name is taken."""
    taken = {one.clip.name for one in made}
    for name in (file.stem, f"{file.parent.name}/{file.stem}", str(file)):
        if name not in taken:
            return name
    return f"{file}#{len(made)}"
