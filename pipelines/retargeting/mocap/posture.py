"""Is the recorded body one like the robot's? Names of joints do not tell a person from a dog."""

from __future__ import annotations

import numpy as np

from lacoloco.datasets.mocap import Mocap
from lacoloco.pipelines.retargeting.mocap.body_map import BodyMap, LegGeometry

STEEPER = 50.0
"""Degrees by which the trunk may stand steeper than the robot's, or lie flatter."""
LOW = 0.3
"""Share of the hips' height below which the end of a limb counts as near the ground."""
MOSTLY = 0.5
"""Share of the frames with a hand near the ground from which arms are legs."""
CARRIES = 0.02
"""Share of the frames in which a limb that carries is near the ground, at least."""


def unlike(mocap: Mocap, mapping: BodyMap, legs: LegGeometry) -> str | None:
    """Why the body in a recording is not one that the robot could take after; None if it may be.

    A sitting dog's trunk is steep, and a paw may be raised all the time: only what has another
    trunk *and* limbs that never come to the ground is refused.
    """
    if mapping.arms:
        return _lies_on_arms(mocap, mapping)
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
    names = mapping.ground_nodes(mocap)
    ends, hips = mocap.keypoints(names)[..., 2], mocap.keypoints(mapping.hips)[..., 2]
    floor = float(np.percentile(ends, 1))
    near = ends - floor < LOW * (float(np.median(hips)) - floor)
    return [name for name, share in zip(names, near.mean(axis=0), strict=True) if share < CARRIES]


def _lies_on_arms(mocap: Mocap, mapping: BodyMap) -> str | None:
    """Why the body cannot stand on two legs: its trunk lies, and what would be its arms carry it.

    A person may lie down or crawl for a while.
    """
    arms = mocap.keypoints([mapping.joints[arm[-1]] for arm in mapping.arms])[..., 2]
    roots = mocap.keypoints([mapping.joints[arm[0]] for arm in mapping.arms])
    hips = mocap.keypoints(mapping.hips)
    trunk = roots.mean(1) - hips.mean(1)
    slope = np.arctan2(trunk[:, 2], np.linalg.norm(trunk[:, :2], axis=-1))
    steep = float(np.degrees(np.median(slope)))
    floor = float(np.percentile(mapping.foot_points(mocap)[..., 2], 1))
    low = LOW * (float(np.median(hips[..., 2])) - floor)
    carried = float((arms - floor < low).any(axis=1).mean())
    if steep > 90.0 - STEEPER or carried < MOSTLY:
        return None
    return (
        f"its trunk lies at {steep:.0f} degrees, and its hands are near the ground in {carried:.0%}"
        f" of the frames, where the robot stands upright on {len(mapping.hips)} feet"
    )


def _steepness(hips: np.ndarray, front: np.ndarray) -> float:
    """Degrees above the horizontal of the line from the hind hips to the front ones, median."""
    trunk = hips[:, front].mean(1) - hips[:, ~front].mean(1)
    level = np.linalg.norm(trunk[:, :2], axis=-1)
    return float(np.degrees(np.median(np.arctan2(trunk[:, 2], level))))
