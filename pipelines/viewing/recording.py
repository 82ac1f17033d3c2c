"""What playback shows: the poses of a robot over time, and whatever else is known about each frame.

Clips and rollouts of policies both become recordings, so that one player shows both.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, cast

import numpy as np

from lacoloco.datasets.clip import Clip
from lacoloco.pipelines.errors import StageError

POSES = ("root_pos", "root_quat", "joint_pos")
EXTRAS = ("target", "latent", "contacts", "skeleton")


@dataclass(frozen=True)
class Recording:
    """T frames of one robot; joints and feet in the order of its RobotSpec."""

    name: str
    fps: float
    root_pos: np.ndarray
    """(T, 3) world, m."""
    root_quat: np.ndarray
    """(T, 4) wxyz, base to world."""
    joint_pos: np.ndarray
    """(T, J) rad."""
    target: np.ndarray | None = None
    """(T, 3) world, m: where the end effector is asked to be."""
    latent: np.ndarray | None = None
    """(T, d) unit latents in force."""
    contacts: np.ndarray | None = None
    """(T, F) bool, which feet stand."""
    skeleton: np.ndarray | None = None
    """(T, K, 3) world, m: points of the animal the motion came from."""
    bones: tuple[tuple[int, int], ...] = ()
    """Pairs of points of `skeleton` that are joined."""
    note: str = ""
    """One line about it."""

    @property
    def frames(self) -> int:
        """Number of frames T."""
        return len(self.root_pos)

    @property
    def duration(self) -> float:
        """Seconds between the first and the last frame."""
        return (self.frames - 1) / self.fps

    def validate(self, joints: int) -> None:
        """Check that all series have T rows of the right width and are finite.

        Raises:
            StageError: The first thing that is wrong.
        """
        widths = {"root_pos": (3,), "root_quat": (4,), "joint_pos": (joints,), "target": (3,)}
        for name in (*POSES, *EXTRAS):
            series = getattr(self, name)
            if series is None:
                continue
            shape = (self.frames, *widths.get(name, series.shape[1:]))
            if series.shape != shape or not np.isfinite(series).all():
                raise StageError(
                    f"recording '{self.name}': {name} must be finite and of shape {shape}, is"
                    f" {series.shape}; record it again"
                )

    def until(self, seconds: float) -> Recording:
        """The part before `seconds`; at least two frames."""
        stop = max(int(seconds * self.fps) + 1, 2)
        series = {name: getattr(self, name) for name in (*POSES, *EXTRAS)}
        cut = {name: rows[:stop] for name, rows in series.items() if rows is not None}
        return replace(self, **cut)


def from_clip(clip: Clip) -> Recording:
    """A clip as a recording."""
    return Recording(
        name=clip.name,
        fps=clip.fps,
        root_pos=np.asarray(clip.root_pos, dtype=np.float64),
        root_quat=np.asarray(clip.root_quat, dtype=np.float64),
        joint_pos=np.asarray(clip.joint_pos, dtype=np.float64),
        contacts=clip.contacts,
        note=_about(clip),
    )


def _about(clip: Clip) -> str:
    """Skill, source and licence in one line, each with its name: alone, "unknown" says nothing."""
    said = {"skill": clip.skill, "source": clip.source, "licence": clip.licence}
    return ", ".join(f"{name}: {value}" for name, value in said.items() if value)


def to_arrays(recordings: Sequence[Recording]) -> tuple[dict[str, np.ndarray], dict[str, Any]]:
    """Arrays and metadata of an artifact of schema lacoloco/playback."""
    arrays = {
        f"{index}/{name}": getattr(recording, name)
        for index, recording in enumerate(recordings)
        for name in (*POSES, *EXTRAS)
        if getattr(recording, name) is not None
    }
    table = [
        {"name": r.name, "fps": r.fps, "note": r.note, "bones": [list(pair) for pair in r.bones]}
        for r in recordings
    ]
    return arrays, {"recordings": table}


def _poses(arrays: Mapping[str, np.ndarray], index: int) -> dict[str, np.ndarray | None]:
    needed = {name: arrays[f"{index}/{name}"] for name in POSES}
    return needed | {name: arrays.get(f"{index}/{name}") for name in EXTRAS}


def from_arrays(arrays: Mapping[str, np.ndarray], metadata: Mapping[str, Any]) -> list[Recording]:
    """Inverse of `to_arrays`.

    Raises:
        StageError: The tables do not fit together.
    """
    try:
        return [
            Recording(
                name=str(row["name"]),
                fps=float(row["fps"]),
                note=str(row["note"]),
                bones=tuple((int(a), int(b)) for a, b in row["bones"]),
                **cast("dict[str, Any]", _poses(arrays, index)),
            )
            for index, row in enumerate(metadata["recordings"])
        ]
    except (KeyError, TypeError, ValueError, AttributeError, OverflowError) as error:
        raise StageError(
            f"the playback's tables do not fit together ({error}); make it again"
        ) from error
