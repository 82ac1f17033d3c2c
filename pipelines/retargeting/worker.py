"""One file from beginning to end: read, checked, retargeted, drawn, written."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

from lacoloco.datasets.beside import FINISHED_CLIPS
from lacoloco.datasets.clip import save_clips
from lacoloco.datasets.errors import DatasetError
from lacoloco.datasets.hashing import hash_file
from lacoloco.datasets.mocap import Mocap, read_bvh
from lacoloco.datasets.provenance import git_commit, lacoloco_version
from lacoloco.datasets.samples import SAMPLES
from lacoloco.pipelines.retargeting.config import RetargetConfig
from lacoloco.pipelines.retargeting.findings import Finding
from lacoloco.pipelines.retargeting.measure.report import write_report
from lacoloco.pipelines.retargeting.mocap.glitches import without_glitches
from lacoloco.pipelines.retargeting.mocap.reading import Reading
from lacoloco.pipelines.retargeting.mocap.skeleton_maps import (
    SkeletonMap,
    choose_map,
    other_robot,
)
from lacoloco.pipelines.retargeting.mocap.trim import trim_range
from lacoloco.pipelines.retargeting.retargeter import Retargeted, Retargeter
from lacoloco.pipelines.retargeting.validation import check_recording
from lacoloco.pipelines.robot import record_of
from lacoloco.robots.registry import load_robot

SAMPLE_LICENCE = "CC0-1.0"
MOST_UNSOLVED = 0.05
"""Share of the frames without a solution from which a clip is a failure."""

Program = tuple[str, str]
"""Version and commit of lacoloco."""


@dataclass(frozen=True)
class Task:
    """A file, the name of its clip, which part of it, and in what variant."""

    path: Path
    name: str
    trim: str = ""
    mirror: bool = False
    bend: float = 0.0


class Worker:
    """Turns files into clips, one after another; derives each robot's programs once.

    Attributes:
        program: Which lacoloco makes the clips.
    """

    def __init__(self, config: RetargetConfig, robot: str, program: Program | None = None) -> None:
        """Read the maps.

        Args:
            config: How to retarget.
            robot: Its name.
            program: That of the process that collects the clips, where it is another one: somebody
                may commit between the start of the two.

        Raises:
            RobotError: Unknown robot.
            StageError: The config's map is none.
        """
        self._config, self._spec, self._maps = config, load_robot(robot), config.maps()
        self._retargeters: dict[str, Retargeter] = {}
        self.program: Program = program or (lacoloco_version(), git_commit())

    def key(self, task: Task) -> str:
        """What a clip depends on, as 64 hexadecimal digits: equal keys, equal clips.

        Raises:
            DatasetError: The file cannot be read, or its name is no text.
        """
        try:
            str(task.path).encode()
        except UnicodeEncodeError:
            raise DatasetError(
                f"{str(task.path)!r}: its name is no UTF-8 text; rename it"
            ) from None
        depends = {
            "file": hash_file(task.path),
            "name": task.name,
            "trim": self._config.trim or task.trim,
            "variant": (task.mirror, task.bend),
            "config": asdict(self._config.key()),
            "maps": [asdict(skeleton) for skeleton in self._maps],
            "robot": record_of(self._spec).digest,
            "program": self.program,
        }
        return hashlib.sha256(json.dumps(depends, sort_keys=True).encode()).hexdigest()

    def read(self, task: Task) -> tuple[Mocap, Reading, Retargeter, list[Finding]]:
        """The motion in a file, how it was read, what retargets it, and what was found.

        Raises:
            DatasetError: It cannot be read, fits no map, or is no motion of an animal on its legs.
        """
        raw = read_bvh(task.path)
        skeleton = choose_map(self._maps, self._spec.name, raw.joint_names, str(task.path))
        if skeleton.name not in self._retargeters:
            options = self._config
            self._retargeters[skeleton.name] = Retargeter(
                *(self._spec, options.mode, options.scale, options.posture_weight, options.clip),
                skeleton,
            )
        retargeter = self._retargeters[skeleton.name]
        pairs = retargeter.map.pairs(raw, retargeter.legs)
        plain = self._config.reading(skeleton, task.trim)
        mirror, bend = plain.mirror != task.mirror, plain.bend + task.bend
        reading = replace(plain, pairs=pairs, mirror=mirror, bend=bend)
        part = trim_range(reading.trim, raw.frames, reading.source_fps or raw.fps)
        raw, findings = without_glitches(raw, retargeter.map, part)
        mocap = replace(reading, fps=0.0).apply(raw)
        findings += check_recording(
            *(mocap, retargeter.map, retargeter.legs, reading, str(task.path)),
            usual_limb=retargeter.limb,
            own_map=bool(self._config.map),
            hint=self._hint(skeleton, raw),
        )
        mocap = mocap.resampled(reading.fps) if reading.fps else mocap
        return mocap, reading, retargeter, findings

    def _hint(self, skeleton: SkeletonMap, raw: Mocap) -> str:
        """Which robot a recording is rather for, by its joints."""
        other = other_robot(self._maps, skeleton, raw.joint_names)
        if other is None:
            return ""
        return f"; its joints are those of the map '{other.name}': --robot {other.robot}"

    def work(
        self, task: Task, folder: Path, on_start: Callable[[int], Callable[[int], None]]
    ) -> dict[str, Any]:
        """Retarget a file; write its clip to `folder` and its picture.

        Args:
            task: The file.
            folder: Of the version; the clip goes to `clip_path`, the picture to `picture_path`.
            on_start: Told the number of frames; what it gives is told how many are done.

        Returns:
            Figures of the clip.

        Raises:
            DatasetError: See `read`; or too many frames could not be solved.
            StageError: No frame could be solved.
        """
        key = self.key(task)
        mocap, reading, retargeter, findings = self.read(task)
        if self.key(task) != key:
            raise DatasetError(f"{task.path}: was written to while it was read; try again")
        own = task.path.resolve() in [sample.resolve() for sample in SAMPLES]
        known = SAMPLE_LICENCE if own else "unknown"
        result = retargeter.clip(
            mocap,
            task.name,
            on_frame=on_start(mocap.frames),
            skill=self._config.skill,
            source=task.path.name,
            licence=self._config.licence or known,
        )
        _refuse_unsolved(task, result, findings)
        findings += result.assessment.findings()
        metrics = {
            **result.metrics(),
            "times_real_time": result.clip.duration / max(result.seconds, 1e-9),
            "warnings": [finding.name for finding in findings],
            "notes": [f"{finding.name}: {finding.text}" for finding in findings],
            "key": key,
            "reading": asdict(reading),
            "paws": list(retargeter.map.ground_nodes(mocap)),
        }
        if self._config.pictures:
            picture = picture_path(folder, task.name)
            picture.parent.mkdir(parents=True, exist_ok=True)
            write_report(picture, result.assessment, metrics)
        finished = clip_path(folder, key)
        finished.parent.mkdir(exist_ok=True)
        finished.unlink(missing_ok=True)  # a damaged one, or it would not be made again
        save_clips(
            finished,
            [result.clip],
            robot=record_of(self._spec),
            config=asdict(self._config),
            parents=[task.path],
            metadata={"metrics": {"clips": [metrics]}},
        )
        return metrics


def _refuse_unsolved(task: Task, result: Retargeted, findings: list[Finding]) -> None:
    """Refuse a clip that is mostly guessed; say the few frames that are."""
    failures, frames = result.failures, result.clip.frames
    if failures > MOST_UNSOLVED * frames:
        known = "; ".join(finding.text for finding in findings)
        raise DatasetError(
            f"{task.path}: {failures} of {frames} frames could not be solved: the robot cannot do"
            f" this at this size{f'; {known}' if known else ''}"
        )
    if failures:
        text = f"{failures} of {frames} frames were not solved; they follow from the others"
        findings.append(Finding("unsolved", text))


def clip_path(folder: Path, key: str) -> Path:
    """Where the clip of a file lies until all are there."""
    return folder / FINISHED_CLIPS / f"{key[:16]}.h5"


def picture_path(folder: Path, name: str) -> Path:
    """Where the report of a clip lies when there are several."""
    return folder / "reports" / f"{name}.png"
