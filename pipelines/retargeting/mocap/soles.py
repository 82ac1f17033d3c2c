"""Feet with a heel and toes: where a person's are, and how the robot's follow them.

A recording has a person's ankle and the joint of the toes. The heel follows from them: it is on the
ground, as far behind the ankle as the robot's relative to its toes, when the foot stands flat, and
turns with the foot. A foot is flat when ankle and toes are at their lowest.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from lacoloco.robots.spec import RobotSpec

LOWEST = 2.0
"""Percentile of heights that counts as that of standing."""
FLATTEST, STEEPEST = 0.1, 0.95
"""Height of an ankle above the toes when a foot is flat, share of their distance: within these."""
UNSURE = 0.3
"""Share of the foot's length: where it is seen shorter from above, the hips help to tell where it
points."""


@dataclass(frozen=True)
class SoleShape:
    """The robot's foot from the side, its sole level, m."""

    length: float
    """From the heel to the toes."""
    behind: float
    """From the heel to the point below the ankle."""
    height: float
    """Of the ankle above heel and toes."""


@dataclass(frozen=True)
class RecordedFeet:
    """F feet through T frames, world, m."""

    ankles: np.ndarray
    """(T, F, 3)"""
    heels: np.ndarray
    """(T, F, 3)"""
    toes: np.ndarray
    """(T, F, 3)"""
    forward: np.ndarray
    """(T, F, 3) level unit vectors, where the feet point."""
    pitch: np.ndarray
    """(T, F) rad, positive with the toes up."""


def sole_shapes(spec: RobotSpec) -> tuple[SoleShape, ...]:
    """Shapes of the robot's feet, in their order; empty where they are single points."""
    shapes, model = [], spec.model()
    for foot, (heel, toes) in spec.soles.items():
        (_, _), (back, front) = spec.located((heel, toes))
        way = np.subtract(front, back)
        ankle = -model.body(foot).pos - back  # in the axes of the foot, which are the ankle's
        length = float(np.linalg.norm(way))
        behind = float(ankle @ way) / length
        shapes.append(
            (foot, SoleShape(length, behind, float(np.linalg.norm(ankle - behind * way / length))))
        )
    known = dict(shapes)
    return tuple(known[foot] for foot in spec.feet) if known else ()


def recorded_feet(nodes: np.ndarray, hips: np.ndarray, soles: Sequence[SoleShape]) -> RecordedFeet:
    """The feet of a person, with their heels.

    Args:
        nodes: (T, 2 F, 3) ankle and toes of each foot, world with z up.
        hips: (T, F, 3) where the legs begin, left and right in the same order.
        soles: Of the robot: how much of a foot is behind the ankle.
    """
    ankles, toes = nodes[:, ::2], nodes[:, 1::2]
    bones = toes - ankles
    size = np.median(np.linalg.norm(bones, axis=-1), axis=0)  # (F,)
    lowest = np.percentile(nodes[..., 2], LOWEST, axis=0)
    above = np.clip(lowest[::2] - lowest[1::2], FLATTEST * size, STEEPEST * size)
    ahead = np.sqrt(size**2 - above**2)
    forward = _directions(bones, hips, size)
    run = (bones * forward).sum(-1)
    pitch = np.arctan2(bones[..., 2], run) - np.arctan2(-above, ahead)
    share = np.array([sole.behind / (sole.length - sole.behind) for sole in soles])
    heels = ankles + sagittal(forward, pitch, -share * ahead, -above)
    return RecordedFeet(ankles, heels, toes, forward, pitch)


def sagittal(
    forward: np.ndarray, pitch: np.ndarray, ahead: np.ndarray, up: np.ndarray
) -> np.ndarray:
    """Vectors (T, F, 3) of a foot that is pitched, toes up, from their parts when it is level.

    Args:
        forward: (T, F, 3) level unit vectors.
        pitch: (T, F) rad.
        ahead: (F,) m.
        up: (F,) m.
    """
    cos, sin = np.cos(pitch), np.sin(pitch)
    vectors = forward * (cos * ahead - sin * up)[..., None]
    vectors[..., 2] += sin * ahead + cos * up
    return vectors


def _directions(bones: np.ndarray, hips: np.ndarray, size: np.ndarray) -> np.ndarray:
    """Where feet point (T, F, 3), level; a foot that is on its tip says little of it."""
    level = bones[..., :2] / size[:, None]
    aside = hips[:, 0, :2] - hips[:, 1, :2]
    facing = np.stack([aside[:, 1], -aside[:, 0]], axis=-1)
    facing /= np.maximum(np.linalg.norm(facing, axis=-1, keepdims=True), 1e-9)
    facing *= np.sign((facing[:, None] * level).sum((0, 1, 2)) or 1.0)
    missing = np.clip(1.0 - np.linalg.norm(level, axis=-1, keepdims=True) / UNSURE, 0.0, 1.0)
    level = level + 0.5 * missing * facing[:, None]
    level /= np.maximum(np.linalg.norm(level, axis=-1, keepdims=True), 1e-9)
    return np.concatenate([level, np.zeros_like(level[..., :1])], axis=-1)
