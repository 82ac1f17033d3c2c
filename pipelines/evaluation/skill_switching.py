"""Which skill each control step of an episode shows, by the clip nearest to it, and whether the
skills switch.

Each control step takes the skill of the clip that its style frame is nearest to, each second the
skill of most of its steps. An episode *walks first and reaches last* when its first second is
walking, its last second is reaching, and it does not fall in between.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch

from lacoloco.pipelines.errors import StageError
from lacoloco.pipelines.evaluation.rollout import ReachRecording
from lacoloco.pipelines.evaluation.skill_classifier import NearestClip

LAST = "reach"
"""The skill to end with; an episode begins with any other, to walk as an expert or as a dog
does.
"""


@dataclass(frozen=True)
class Switching:
    """T control steps of E episodes.

    Attributes:
        skills: names of the clips' skills.
        nearest: (E, T) index of the skill whose clips are nearest.
        distances: (E, T, skills) distance to the nearest moment of each skill.
        error: (E, T) distance of the end effector from the target [m].
        fell: (E,) bool.
        fps: steps per second.
    """

    skills: tuple[str, ...]
    nearest: np.ndarray
    distances: np.ndarray
    error: np.ndarray
    fell: np.ndarray
    fps: float

    @property
    def walks_first(self) -> np.ndarray:
        """(E,) bool: the first second is nearest to other clips than reaching ones."""
        return self._reaching(slice(None, round(self.fps))) < 0.5

    @property
    def reaches_last(self) -> np.ndarray:
        """(E,) bool: the last second is nearest to reaching clips."""
        return self._reaching(slice(-round(self.fps), None)) > 0.5

    @property
    def switches(self) -> np.ndarray:
        """(E,) bool: walks first, reaches last, and does not fall."""
        return self.walks_first & self.reaches_last & ~self.fell

    def typical(self) -> int:
        """The episode with the median error at its end, of those that switch, or of all where none
        does.
        """
        candidates = (
            np.flatnonzero(self.switches) if self.switches.any() else np.arange(len(self.fell))
        )
        order = np.argsort(self.error[candidates, -1], kind="stable")
        return int(candidates[order[(len(order) - 1) // 2]])

    def metrics(self) -> dict[str, float]:
        """Shares of episodes, and the mean share of steps that are nearest to reaching clips."""
        return {
            "walk_first_reach_last": float(self.switches.mean()),
            "walk_first": float(self.walks_first.mean()),
            "reach_last": float(self.reaches_last.mean()),
            "reach_steps": float((self.nearest == self.skills.index(LAST)).mean()),
            "falls": float(self.fell.mean()),
            "final_error_m": float(self.error[:, -1].mean()),
        }

    def _reaching(self, steps: slice) -> np.ndarray:
        """(E,) share of these steps that are nearest to reaching clips."""
        return (self.nearest[:, steps] == self.skills.index(LAST)).mean(axis=1)


def compare(played: ReachRecording, nearest: NearestClip) -> Switching:
    """Find the nearest skill of every step by its clean style frame.

    Raises:
        StageError: The task has no target.
    """
    if played.target is None:
        raise StageError("the policy's task has no target, so there is no reaching to count")
    episodes, steps = played.frame.shape[:2]
    flat = torch.from_numpy(played.frame).flatten(0, 1)
    distances = nearest.distances(flat).numpy().reshape(episodes, steps, -1)
    error = np.linalg.norm(played.end_effector - played.target, axis=-1)
    index = distances.argmin(axis=-1).astype(np.uint8)
    return Switching(nearest.skills, index, distances, error, played.fell, played.fps)
