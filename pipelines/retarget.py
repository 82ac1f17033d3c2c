"""Stage retarget: motion capture (.bvh) -> clips of the robot.

Each file becomes one clip. A file that cannot be read is reported and left out; a frame that the
solver cannot solve is blended from its neighbours and counted.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np

from lacoloco.datasets.clip import Clip, save_clips
from lacoloco.datasets.errors import DatasetError
from lacoloco.datasets.mocap import Mocap, UpAxis, load_bvh
from lacoloco.datasets.samples import DOG_BVH
from lacoloco.pipelines.errors import StageError
from lacoloco.pipelines.kinematics import BodyPositions
from lacoloco.pipelines.retargeting import quality
from lacoloco.pipelines.retargeting.body_map import body_map, leg_geometry
from lacoloco.pipelines.retargeting.filters import lower_envelope
from lacoloco.pipelines.retargeting.pose_problem import PoseProblem, retarget_bounds
from lacoloco.pipelines.retargeting.sources import clip_names, find_recordings
from lacoloco.pipelines.retargeting.targets import Targets, fitted_targets, plain_targets
from lacoloco.pipelines.stage import StageContext, StageResult
from lacoloco.robots.registry import load_robot
from lacoloco.robots.spec import RobotSpec

STAGE = "retarget"
SAMPLE_LICENCE = "BSD-3-Clause"

GROUND_REACH = 0.5
"""s; a clip is set on the ground by its lowest feet within this time, so that leaps stay leaps."""


@dataclass(frozen=True)
class RetargetConfig:
    """What is retargeted, and how.

    Attributes:
        scale: "none" for the animal's own size (paper), "auto" to fit it to the robot, or a factor
            with the rest of the fit.
        posture_weight: alpha of the paper, m^2/rad^2.
        up_axis: Axis of the files that points up.
        unit: Metres per unit of the files.
        skill: Skill of the clips.
        licence: Licence of the files; that of the bundled sample is known.
    """

    scale: str = "auto"
    posture_weight: float = 0.005
    up_axis: UpAxis = "y"
    unit: float = 0.01
    skill: str = "dog"
    licence: str = ""


def laptop() -> RetargetConfig:
    """Clips for training: the dog fitted to the robot."""
    return RetargetConfig()


def smoke() -> RetargetConfig:
    """The same; retargeting is quick as it is."""
    return RetargetConfig()


def paper() -> RetargetConfig:
    """The paper's problem: the dog in its own size."""
    return RetargetConfig(scale="none")


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
        out), `frames` and `frames_per_second` of the solver.

    Raises:
        StageError: A folder or pattern without files, an impossible scale, or no clip at all.
        RobotError: Unknown robot.
        DatasetError: The only file cannot be used.
    """
    paths = find_recordings(sources or [DOG_BVH])
    retargeter = Retargeter(load_robot(robot), config)
    made: list[tuple[Path, Clip, dict[str, Any]]] = []
    skipped: list[dict[str, str]] = []
    for path, name in zip(paths, clip_names(paths), strict=True):
        try:
            made.append((path, *retargeter.clip(path, name, context)))
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
        "clips": [figures for _, _, figures in made],
        "skipped": skipped,
        "frames": sum(clip.frames for _, clip, _ in made),
        "frames_per_second": retargeter.frames_per_second,
    }
    directory = context.store.begin(context.run, STAGE)
    save_clips(
        directory.file("artifact.h5"),
        [clip for _, clip, _ in made],
        robot=(retargeter.spec.name, retargeter.spec.model_hash()),
        config=asdict(config),
        seed=context.seed,
        parents=[path for path, _, _ in made],
        command=context.command,
        metadata={"metrics": metrics},
    )
    return StageResult(directory.complete(), metrics)


class Retargeter:
    """One robot with its program, built once for all clips."""

    def __init__(self, spec: RobotSpec, config: RetargetConfig) -> None:
        """Build it.

        Raises:
            StageError: The robot cannot be retargeted to, or the scale is none.
        """
        self.spec, self.config = spec, config
        self._scale = parse_scale(config.scale)
        self._problem = PoseProblem(spec, config.posture_weight)
        self._map = body_map(spec)
        self._legs = leg_geometry(spec, self._map)
        self._positions = BodyPositions(
            spec.pinocchio_model(), (*spec.keypoints.values(), *spec.feet)
        )
        self._frames, self._seconds = 0, 0.0

    @property
    def frames_per_second(self) -> float:
        """Frames retargeted so far per second of one core, reading and building left out."""
        return self._frames / self._seconds if self._seconds else 0.0

    def clip(self, path: Path, name: str, context: StageContext) -> tuple[Clip, dict[str, Any]]:
        """Retarget one file.

        Args:
            path: The file.
            name: Name of the clip.
            context: For its progress.

        Returns:
            The clip and its quality.

        Raises:
            DatasetError: The file cannot be read, lacks a joint, or has a single frame.
            StageError: No frame could be solved.
        """
        mocap = load_bvh(path, up_axis=self.config.up_axis, scale=self.config.unit)
        if mocap.frames < 2:
            raise DatasetError(f"{path}: has one frame; a motion needs at least two")
        started = time.process_time()
        targets = self._targets(mocap)
        context.progress.start(f"{STAGE} {name}", mocap.frames)
        motion = self._problem.track(targets.points, context.progress.advance)
        context.progress.stop()
        points = self._positions(motion.root_pos, motion.root_quat, motion.joint_pos)
        keypoints, feet = np.split(points, [len(self.spec.keypoints)], axis=1)
        radius = self.spec.foot_radius()
        lift = ground_lift(feet[..., 2], radius, mocap.fps)
        self._frames += mocap.frames
        self._seconds += time.process_time() - started
        clip = Clip.from_poses(
            name,
            mocap.fps,
            self.spec.joint_names,
            motion.root_pos + lift,
            motion.root_quat,
            motion.joint_pos,
            skill=self.config.skill,
            source=path.name,
            licence=self._licence(path),
            contacts=targets.contacts,
        )
        figures = {
            "name": name,
            "frames": clip.frames,
            "scale": targets.scale,
            **quality.keypoint_errors(keypoints, targets.points),
            **quality.foot_quality(feet + lift[:, None], targets.contacts, radius, mocap.fps),
            **quality.limit_hits(motion.joint_pos, retarget_bounds(self.spec)),
            "solver_failures": int(motion.failed.sum()),
        }
        return clip, figures

    def _targets(self, mocap: Mocap) -> Targets:
        if self._scale is None:
            return plain_targets(mocap, tuple(self.spec.keypoints), self._map)
        factor = None if self._scale == "auto" else self._scale
        return fitted_targets(mocap, self._map, self._legs, self.spec.foot_radius(), factor)

    def _licence(self, path: Path) -> str:
        known = SAMPLE_LICENCE if path.resolve() == DOG_BVH.resolve() else "unknown"
        return self.config.licence or known


def parse_scale(text: str) -> float | Literal["auto"] | None:
    """Read `scale`: None for "none", "auto", or a positive factor.

    Raises:
        StageError: It is something else.
    """
    if text in ("none", "auto"):
        return None if text == "none" else "auto"
    try:
        factor = float(text)
    except ValueError:
        factor = 0.0
    if not 0.0 < factor < np.inf:
        raise StageError(f"scale '{text}': use none, auto or a positive factor")
    return factor


def ground_lift(feet_height: np.ndarray, radius: float, fps: float) -> np.ndarray:
    """Shift (T, 3) that sets a clip on the ground as a whole.

    The paper moves every frame until its lowest foot touches, which deletes all flight and shakes
    the base. Here the shift follows the lowest feet of the surrounding second, smoothly, and never
    leaves a foot in the ground.

    Args:
        feet_height: (T, F) heights of the centres of the foot spheres, m.
        radius: Of the spheres, m.
        fps: Frames per second.
    """
    lowest = lower_envelope(feet_height.min(1), max(int(GROUND_REACH * fps), 1))
    return np.stack([0 * lowest, 0 * lowest, radius - lowest], axis=1)
