"""A clip: what a robot does over time, as a fixed-rate series of its state.

On disk, all clips of a set are one artifact of flat arrays with offsets, which loads ten times
faster than a group per clip.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, overload

import numpy as np

from lacoloco.datasets import rotations, series
from lacoloco.datasets.artifact import Artifact, read_artifact, write_artifact
from lacoloco.datasets.errors import ArtifactError, DatasetError
from lacoloco.datasets.flat_clips import FlatClips
from lacoloco.datasets.robot_record import RobotRecord

SCHEMA = "lacoloco/motions"

_FORGOTTEN: dict[str, Any] = {"joint_target": None, "command": None, "gait_memory": None}
"""What holds at a clip's own pace and rate only."""
_TABLE = ("name", "fps", "skill", "weight", "source", "licence")
_UNSAID: dict[str, Any] = {"skill": "", "weight": 1.0, "source": "", "licence": ""}


@dataclass(frozen=True)
class Clip:
    """States of one robot at T equally spaced times, and what is known about them.

    Frame k is the state at time k / fps. The base frame is the robot's root body; w is the world
    frame with z up; _b means expressed in the base frame.
    """

    name: str
    fps: float
    joint_names: tuple[str, ...]
    """The J joints, in the order of the columns of joint_pos and joint_vel."""
    root_pos: np.ndarray
    """(T, 3) position of the base in the world frame, m."""
    root_quat: np.ndarray
    """(T, 4) orientation (w, x, y, z) that turns base vectors into world vectors."""
    root_lin_vel_b: np.ndarray
    """(T, 3) linear velocity of the base origin in the base frame, m/s."""
    root_ang_vel_b: np.ndarray
    """(T, 3) angular velocity of the base in the base frame, rad/s."""
    joint_pos: np.ndarray
    """(T, J) rad."""
    joint_vel: np.ndarray
    """(T, J) rad/s."""
    skill: str = ""
    """Group for weighting and reports: "walk", "reach", "dog"..."""
    weight: float = 1.0
    """Factor on the share of the clip among samples."""
    source: str = ""
    licence: str = ""
    contacts: np.ndarray | None = None
    """(T, F) bool, which feet touch the ground, if known."""
    joint_target: np.ndarray | None = None
    """(T, J) rad, where the motors were asked to go from frame k to k + 1, if a robot performed the
    clip; the last row leads nowhere.
    """
    command: np.ndarray | None = None
    """(T, 3) what was commanded from frame k to k + 1, if an expert performed the clip: a velocity
    (forward and lateral m/s, yaw rate rad/s) or a target in the world frame, m.
    """
    gait_memory: np.ndarray | None = None
    """(T, 3) where the expert's gait clock stood, if it had one: `GaitClock.memory`."""

    @classmethod
    def from_poses(
        cls,
        name: str,
        fps: float,
        joint_names: Sequence[str],
        root_pos: np.ndarray,
        root_quat: np.ndarray,
        joint_pos: np.ndarray,
        *,
        skill: str = "",
        weight: float = 1.0,
        source: str = "",
        licence: str = "",
        contacts: np.ndarray | None = None,
    ) -> Clip:
        """Make a clip from poses alone; velocities by central differences, one-sided at the ends.

        Args:
            name: name of the clip.
            fps: frames per second.
            joint_names: the J joints.
            root_pos: (T, 3) world, m.
            root_quat: (T, 4) wxyz, base to world; signs may flip between frames.
            joint_pos: (T, J) rad, without jumps by 2 pi.
            skill: see the class; so are weight, source, licence and contacts.
            weight: factor on the share of the clip among samples.
            source: where the motion comes from.
            licence: its licence.
            contacts: (T, F) bool.

        Raises:
            DatasetError: shapes do not fit, fewer than two frames, or values that are not finite.
        """
        root_pos, root_quat, joint_pos = map(np.asarray, (root_pos, root_quat, joint_pos))
        clip = cls(
            name=name,
            fps=float(fps),
            joint_names=tuple(joint_names),
            root_pos=root_pos,
            root_quat=root_quat,
            root_lin_vel_b=np.zeros_like(root_pos),
            root_ang_vel_b=np.zeros_like(root_pos),
            joint_pos=joint_pos,
            joint_vel=np.zeros_like(joint_pos),
            skill=skill,
            weight=weight,
            source=source,
            licence=licence,
            contacts=contacts,
        )
        clip.validate()
        if len(root_pos) < 2:
            raise DatasetError(f"clip '{name}': has one frame; velocities need at least two")
        quat = rotations.continuous(rotations.normalize(root_quat))
        lin_vel_w = np.gradient(root_pos, 1 / clip.fps, axis=0)
        return replace(
            clip,
            root_quat=quat,
            root_lin_vel_b=rotations.rotate_inverse(quat, lin_vel_w),
            root_ang_vel_b=series.angular_velocities_b(quat, clip.fps),
            joint_vel=np.gradient(joint_pos, 1 / clip.fps, axis=0),
        )

    @property
    def frames(self) -> int:
        """Number of frames T."""
        return len(self.root_pos)

    @property
    def duration(self) -> float:
        """Seconds between the first and the last frame, (T - 1) / fps."""
        return (self.frames - 1) / self.fps

    def validate(self) -> None:
        """Check shapes, finiteness and unit quaternions.

        Raises:
            DatasetError: the first thing that is wrong, with the name of the clip.
        """
        problem = _problem_of(self.fps, self.weight, Counter(self.joint_names))
        problem = problem or series.problem(self._rows(), len(self.joint_names))
        if problem:
            raise DatasetError(f"clip '{self.name}': {problem}")

    def slice(self, start: int, stop: int) -> Clip:
        """Frames start to stop (exclusive, at most `frames`), as views.

        Raises:
            DatasetError: no frame is left.
        """
        if not 0 <= start < stop <= self.frames:
            raise DatasetError(
                f"clip '{self.name}': frames {start}:{stop} are not within 0:{self.frames}"
            )
        return self._with({name: rows[start:stop] for name, rows in self._rows().items()})

    def resample(self, fps: float) -> Clip:
        """The same motion at another rate: linear between frames, slerp for the orientation.

        The last frame is the last one that fits into the duration; contacts are the nearest ones.
        What the motors were asked for makes sense at the clip's own rate only: it is left out.

        Raises:
            DatasetError: fps is not positive.
        """
        if not 0 < fps < np.inf:
            raise DatasetError(f"clip '{self.name}': cannot resample to {fps} frames per second")
        clip = self if fps == self.fps else replace(self, **_FORGOTTEN)
        return replace(clip, fps=float(fps))._with(series.resampled(clip._rows(), self.fps, fps))

    def at_pace(self, pace: float) -> Clip:
        """The same path ``pace`` times as fast, at other frames per second; without what the motors
        were asked for.

        Raises:
            DatasetError: pace is not positive.
        """
        if not 0 < pace < np.inf:
            raise DatasetError(f"clip '{self.name}': cannot be played at {pace} times its pace")
        slowed = {name: pace * getattr(self, name) for name in series.VELOCITIES}
        return replace(self, fps=pace * self.fps, **_FORGOTTEN, **slowed)

    def _rows(self) -> dict[str, np.ndarray]:
        known = (name for name in series.OPTIONAL if getattr(self, name) is not None)
        return {name: getattr(self, name) for name in (*series.SERIES, *known)}

    def _with(self, rows: Mapping[str, Any]) -> Clip:
        """The clip with other series, by name."""
        return replace(self, **rows)


def _problem_of(fps: float, weight: float, joints: Counter[str]) -> str:
    """What is wrong with a clip besides its series, in words; "" when nothing is."""
    if not 0 < fps < np.inf:
        return f"has {fps} frames per second"
    if max(joints.values(), default=1) > 1:
        return "names a joint twice"
    if not 0 <= weight < np.inf:
        return f"has weight {weight}; it must be zero or positive"
    return ""


def save_clips(
    path: Path,
    clips: Sequence[Clip],
    *,
    robot: RobotRecord | tuple[str, str] | None,
    config: Mapping[str, Any],
    seed: int | None = None,
    parents: Sequence[Path] = (),
    command: str = "",
    metadata: Mapping[str, Any] | None = None,
) -> Path:
    """Write clips of one robot as an artifact, in single precision.

    Args:
        path: file to make.
        clips: at least one, all with the same joints.
        robot: the robot; name and model hash where no more is known.
        config: resolved configuration of the stage that made them.
        seed: its seed.
        parents: the files they were made of.
        command: the command line.
        metadata: further values for readers; "clips" and "joint_names" are taken.

    Raises:
        DatasetError: no clips, clips with different joints, or a clip that is not valid.
        ArtifactError: the file exists or cannot be written.
    """
    joint_names = common_joints(clips)
    if not isinstance(clips, Clips):
        for clip in clips:
            clip.validate()
    arrays = flat_clips(clips).to_store()
    table = table_of(clips)
    return write_artifact(
        path,
        SCHEMA,
        arrays,
        metadata={**(metadata or {}), "joint_names": list(joint_names), "clips": table},
        config=config,
        seed=seed,
        robot=robot,
        parents=parents,
        command=command,
    )


def load_clips(path: Path, *, robot: str | None = None) -> Clips:
    """Read all clips of a motions artifact; their arrays are views into the flat ones, and those
    are the bytes of the file, which is mapped into memory.

    Raises:
        ArtifactError: see `read_artifact`; also when the tables do not fit together.
    """
    return clips_of(read_artifact(path, SCHEMA, robot=robot, mapped=True))


def clips_of(artifact: Artifact) -> Clips:
    """The clips of a motions artifact that was read already.

    Raises:
        ArtifactError: its tables do not fit together.
    """
    try:
        metadata = artifact.metadata
        table = metadata["clips"]
        if not table:
            raise DatasetError("it holds no clips")
        joint_names = tuple(str(name) for name in metadata["joint_names"])
        for row in table:
            _check_row(row)
        clips = Clips(FlatClips.stored(artifact.arrays, len(table)), joint_names, table)
        clips.validate()
        return clips
    except (KeyError, IndexError, TypeError, ValueError, AttributeError) as error:
        raise ArtifactError(
            f"{artifact.path}: its tables do not fit together ({error}); run the stage that made"
            " it again"
        ) from error


class Clips(Sequence[Clip]):
    """All clips of a set, as they are stored; each is put together when it is asked for."""

    def __init__(
        self, flat: FlatClips, joint_names: tuple[str, ...], table: Sequence[Mapping[str, Any]]
    ) -> None:
        """Take the series of all clips, their joints, and name, fps, skill... of each."""
        self.flat, self.joint_names, self.table = flat, joint_names, table

    def __len__(self) -> int:
        """Number of clips."""
        return len(self.table)

    @overload
    def __getitem__(self, index: int) -> Clip: ...
    @overload
    def __getitem__(self, index: slice) -> list[Clip]: ...
    def __getitem__(self, index: int | slice) -> Clip | list[Clip]:
        """One clip, its arrays views into the flat ones, or several."""
        if isinstance(index, slice):
            return [self[one] for one in range(*index.indices(len(self)))]
        one = range(len(self))[index]
        rows: dict[str, Any] = self.flat.rows(one)
        return Clip(**self.table[one], joint_names=self.joint_names, **rows)

    def validate(self) -> None:
        """Check all that `Clip.validate` checks of each.

        Raises:
            DatasetError: the first thing that is wrong, with the name of the clip.
        """
        names = Counter(self.joint_names)
        for row in self.table:
            problem = _problem_of(row["fps"], row.get("weight", 1.0), names)
            if problem:
                raise DatasetError(f"clip '{row['name']}': {problem}")
        index, problem = self.flat.problem(len(self.joint_names))
        if problem:
            raise DatasetError(f"clip '{self.table[index]['name']}': {problem}")


def table_of(clips: Sequence[Clip]) -> list[dict[str, Any]]:
    """What is known of each clip besides its series: name, fps, skill, weight, source, licence."""
    if isinstance(clips, Clips):
        return [{**_UNSAID, **row} for row in clips.table]
    return [{name: getattr(clip, name) for name in _TABLE} for clip in clips]


def flat_clips(clips: Sequence[Clip], optional: Sequence[str] = series.OPTIONAL) -> FlatClips:
    """The series of clips, all frames one after the other: as they are stored, or copied.

    Args:
        clips: at least one, all with the same joints.
        optional: those of `series.OPTIONAL` that are wanted.

    Raises:
        DatasetError: they know of different numbers of feet.
    """
    if isinstance(clips, Clips):
        return clips.flat
    for name in optional:
        widths = {
            rows.shape[-1]: clip.name for clip in clips if (rows := getattr(clip, name)) is not None
        }
        if len(widths) > 1:
            one, other = list(widths.values())[:2]
            raise DatasetError(f"clips '{one}' and '{other}' differ in the width of their {name}")
    return FlatClips.of([clip._rows() for clip in clips], optional)


def _check_row(row: Mapping[str, Any]) -> None:
    """Refuse a row of the stored table with a value of another type than a clip has there."""
    if not {"name", "fps"} <= row.keys() <= set(_TABLE):
        raise ValueError(f"a clip has {', '.join(row)}")
    for name, value in row.items():
        kind = (int, float) if name in ("fps", "weight") else str
        if not isinstance(value, kind) or isinstance(value, bool):
            raise TypeError(f"{name} of a clip is {type(value).__name__}")


def common_joints(clips: Sequence[Clip]) -> tuple[str, ...]:
    """The joints that all clips share, in order.

    Raises:
        DatasetError: no clips, or clips of different joints.
    """
    if not clips:
        raise DatasetError("there are no clips; give at least one")
    if isinstance(clips, Clips):
        return clips.joint_names
    for clip in clips:
        if clip.joint_names != clips[0].joint_names:
            raise DatasetError(
                f"clip '{clip.name}' has other joints than '{clips[0].name}'; clips of one library"
                " belong to one robot"
            )
    return clips[0].joint_names
