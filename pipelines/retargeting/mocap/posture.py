"""Is the recorded body one like the robot's? Names of joints do not tell a person from a dog."""

from __future__ import annotations

import numpy as np

from lacoloco.datasets.mocap import Mocap
from lacoloco.pipelines.retargeting.mocap.body_map import BodyMap, LegGeometry

STEEPER = 50.0
"""Degrees by which the trunk may stand steeper than the robot's, or lie flatter."""
LOW = 0.3
"""Share of the hips' height below which the end of a limb counts as near the ground."""
CARRIES = 0.02
"""Share of the frames in which a limb that carries is near the ground, at least."""


def unlike(mocap: Mocap, mapping: BodyMap, legs: LegGeometry) -> str | None:
    """Why the body in a recording is not one that the robot could take after; None if it may be.

    A sitting dog's trunk is steep, and a paw may be raised all the time: only what has another
    trunk *and* limbs that never come to the ground is refused.
    """
    front = legs.hips[:, 0] > legs.hips[:, 0].mean() + 1e-6
    if not front.any() or front.all():
        return None  # all legs begin at one place: there is no trunk between them
    ours = _steepness(legs.hips[None], front)
    theirs = _steepness(mocap.keypoints(mapping.hips), front)
    idle = idle_limbs(mocap, mapping)
    if abs(theirs - ours) < STEEPER or not idle:
        return None
    return (
        f"its trunk stands at {theirs:.0f} degrees, the robot's at {ours:.0f}, and"
        f" {', '.join(idle)} never come near the ground, where the robot stands on"
        f" {len(mapping.feet)} feet"
    )


def idle_limbs(mocap: Mocap, mapping: BodyMap) -> list[str]:
    """Nodes that should touch the ground and never come near it."""
    names = mapping.limb_ends(mocap)
    ends, hips = mocap.keypoints(names)[..., 2], mocap.keypoints(mapping.hips)[..., 2]
    floor = float(np.percentile(ends, 1))
    near = ends - floor < LOW * (float(np.median(hips)) - floor)
    return [name for name, share in zip(names, near.mean(axis=0), strict=True) if share < CARRIES]


def _steepness(hips: np.ndarray, front: np.ndarray) -> float:
    """Degrees above the horizontal of the line from the hind hips to the front ones, median."""
    trunk = hips[:, front].mean(1) - hips[:, ~front].mean(1)
    level = np.linalg.norm(trunk[:, :2], axis=-1)
    return float(np.degrees(np.median(np.arctan2(trunk[:, 2], level))))
