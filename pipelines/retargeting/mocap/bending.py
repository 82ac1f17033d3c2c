"""A recording on a bent course: who walked straight on walks a curve, and what stood on the ground
still stands.

Recordings of animals turn little, and a policy that learned from them turns no faster. The whole
plane is bent along the animal's course, as a strip of paper is: a point keeps how far along and
beside the course it is. That does not depend on time, so a paw that stands is not moved; trunk and
neck follow the curve, limbs keep their heights. Only where an animal turns back on its own track do
the two tracks part, and what stands between them jumps.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from lacoloco.datasets.errors import DatasetError
from lacoloco.datasets.mocap import Mocap
from lacoloco.pipelines.retargeting.filters import smooth

COURSE_SIGMA = 0.25
"""s; the course is that of the smoothed middle of all nodes, without the sway of single steps."""
MOVING = 0.1
"""m/s; slower, an animal has the direction that it had or will have when it moves."""
CORNER = 0.25
"""m along the course over which it is rounded: who turns on the spot stands where normals cross."""
STEP = 0.02
"""m between the points of a course."""


@dataclass(frozen=True)
class Course:
    """G points along a curve in the plane, ``STEP`` apart by arc length, and beyond its ends
    straight on.
    """

    points: np.ndarray
    """(G, 2) m."""
    angles: np.ndarray
    """(G,) rad, directions of travel."""

    def bent(self, curvature: float, origin: int) -> Course:
        """The course with ``curvature`` [1/m] added, held at its point ``origin``."""
        turn = curvature * STEP * (np.arange(len(self.points)) - origin)
        middle = (turn[1:] + turn[:-1]) / 2
        steps = _rotate(np.diff(self.points, axis=0), middle)
        points = np.concatenate((np.zeros((1, 2)), np.cumsum(steps, axis=0)))
        return Course(points - points[origin] + self.points[origin], self.angles + turn)

    def carry(
        self, points: np.ndarray, near: np.ndarray, to: Course
    ) -> tuple[np.ndarray, np.ndarray]:
        """The points (T, 2) that lie to the course ``to`` as ``points`` (T, 2) lie to this one.

        Args:
            points: m.
            near: (T, W) indices of the course among which the nearest point of it is looked for: a
                course may cross itself.
            to: with as many points.

        Returns:
            The points, and how far beside the course they are (T,), positive to the left [m].
        """
        away = points[:, None] - self.points[near]
        nearest = np.take_along_axis(near, (away**2).sum(-1).argmin(1)[:, None], 1)[:, 0]
        along, beside = self._parts(points, nearest)
        other = np.clip(nearest + np.where(along >= 0, 1, -1), 0, len(self.points) - 1)
        further, _ = self._parts(points, other)
        # between the two whose normals have the point on different sides, so that nothing jumps
        # from one to the next
        between = along * further < 0
        share = np.where(between, along / np.where(between, along - further, 1.0), 0.0)[:, None]
        carried = (1 - share) * self._rigidly(points, nearest, to) + share * self._rigidly(
            points, other, to
        )
        return carried, beside

    def _parts(self, points: np.ndarray, at: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """How far ahead of and to the left of the course's points ``at`` (T,) the points (T, 2)
        are.
        """
        away = _rotate(points - self.points[at], -self.angles[at])
        return away[:, 0], away[:, 1]

    def _rigidly(self, points: np.ndarray, at: np.ndarray, to: Course) -> np.ndarray:
        turned = _rotate(points - self.points[at], to.angles[at] - self.angles[at])
        return to.points[at] + turned


def bent(mocap: Mocap, curvature: float) -> Mocap:
    """A recording on a course that is bent to the left everywhere by ``curvature`` [1/m] more than
    it is.

    A recording that goes nowhere stays as it is.

    Raises:
        DatasetError: part of the animal would be bent beyond the centre of the curve.
    """
    if curvature == 0.0:
        return mocap
    centre = smooth(mocap.positions[..., :2].mean(1), COURSE_SIGMA * mocap.fps)
    travelled = _travelled(centre, mocap.fps)
    if travelled is None:
        return mocap
    reach = (
        int(
            np.ceil(
                np.linalg.norm(mocap.positions[..., :2] - centre[:, None], axis=-1).max() / STEP
            )
        )
        + 1
    )
    course = _course(centre, *travelled, reach)
    to = course.bent(curvature, reach)
    at = reach + np.rint(travelled[0] / STEP).astype(int)
    near = np.clip(at[:, None] + np.arange(-reach, reach + 1), 0, len(course.points) - 1)
    positions = mocap.positions.copy()
    for node in range(positions.shape[1]):
        positions[:, node, :2], beside = course.carry(positions[:, node, :2], near, to)
        widest = float((beside * np.sign(curvature)).max())
        if widest * abs(curvature) >= 1.0:
            raise DatasetError(
                f"{mocap.name}: bent by {curvature:g}/m, the centre of the curve would lie within "
                "the animal; use at most"
                f" {0.9 / widest:.2g}"
            )
    return replace(mocap, positions=positions)


def _travelled(centre: np.ndarray, fps: float) -> tuple[np.ndarray, np.ndarray] | None:
    """How far (T,) [m] a centre (T, 2) has come and in which direction (T,) [rad] it goes; None if
    it never moves.
    """
    if len(centre) < 2:
        return None
    velocity = np.gradient(centre, 1 / fps, axis=0)
    moving = np.linalg.norm(velocity, axis=1) > MOVING
    if not moving.any():
        return None
    frames = np.arange(len(centre))
    angle = np.unwrap(np.arctan2(velocity[moving, 1], velocity[moving, 0]))
    angle = np.interp(frames, frames[moving], angle)
    forward = velocity[:, 0] * np.cos(angle) + velocity[:, 1] * np.sin(angle)
    gone = np.concatenate(([0.0], np.cumsum((forward[1:] + forward[:-1]) / 2 / fps)))
    return np.maximum.accumulate(np.maximum(gone, 0.0)), angle


def _course(centre: np.ndarray, gone: np.ndarray, angle: np.ndarray, reach: int) -> Course:
    """The course of a centre (T, 2), with ``reach`` points before and after it."""
    _, first = np.unique(gone, return_index=True)
    grid = STEP * np.arange(int(np.rint(gone[-1] / STEP)) + 1)
    points = np.stack(
        [np.interp(grid, gone[first], centre[first, axis]) for axis in range(2)], axis=1
    )
    ends = STEP * np.arange(1, reach + 1)[:, None]
    before = points[0] - ends[::-1] * _direction(angle[0])
    after = points[-1] + ends * _direction(angle[-1])
    points = smooth(np.concatenate((before, points, after)), CORNER / STEP)
    tangents = np.gradient(points, axis=0)
    return Course(points, np.unwrap(np.arctan2(tangents[:, 1], tangents[:, 0])))


def _direction(angle: float) -> np.ndarray:
    return np.array([np.cos(angle), np.sin(angle)])


def _rotate(vectors: np.ndarray, angles: np.ndarray) -> np.ndarray:
    """Vectors (T, 2) turned to the left by angles (T,)."""
    cos, sin = np.cos(angles), np.sin(angles)
    x, y = vectors[:, 0], vectors[:, 1]
    return np.stack((cos * x - sin * y, sin * x + cos * y), axis=1)
