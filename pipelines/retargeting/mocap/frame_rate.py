"""Is a recording as fast as its file says? Legs swing like pendulums: their length tells how long.

Recorded dogs swing their legs for 1.2 to 1.6 times sqrt(length / gravity), whether they walk, trot
or gallop, and a person who walks for 1.3 times; the trunk falls no faster than gravity lets it.
"""

from __future__ import annotations

import numpy as np

from lacoloco.datasets.mocap import Mocap
from lacoloco.pipelines.retargeting.filters import smooth
from lacoloco.pipelines.retargeting.mocap.body_map import BodyMap
from lacoloco.pipelines.retargeting.targets.contacts import ContactRule, detect_contacts, phases

GRAVITY = 9.81
SWING = (0.85, 1.95)
"""Shortest and longest usual swing, in sqrt(length / gravity)."""
TYPICAL_SWING = 1.4
FEWEST_SWINGS = 8
FALL = 1.2
"""Times gravity by which the body falls in one frame of a hundred: the recording is too fast."""
RATES = (24.0, 25.0, 30.0, 50.0, 60.0, 90.0, 100.0, 120.0, 200.0, 240.0)


def likely_rate(mocap: Mocap, mapping: BodyMap, limb: float) -> tuple[float, str] | None:
    """The rate that a recording seems to have, and why, where its own is implausible.

    Args:
        mocap: With z up, in metres.
        mapping: Its limbs.
        limb: Their length, m.
    """
    ends, root = mapping.foot_points(mocap), mocap.keypoints(mapping.hips).mean(1)
    standing = mapping.standing(detect_contacts(ends, root, mocap.fps, ContactRule()))
    swings = [
        (stop - start) / mocap.fps
        for _, start, stop in phases(~standing)
        if start > 0 and stop < mocap.frames
    ]
    unit = float(np.sqrt(limb / GRAVITY))
    if len(swings) >= FEWEST_SWINGS:
        swing = float(np.median(swings))
        if not SWING[0] <= swing / unit <= SWING[1]:
            usual = f"{SWING[0] * unit:.2g} to {SWING[1] * unit:.2g} s are usual for their length"
            return _nearest(mocap.fps * swing / unit / TYPICAL_SWING), (
                f"its legs swing for {swing:.2g} s, {usual}"
            )
    fall = _fall(mocap)
    if fall > FALL:
        return _nearest(mocap.fps / np.sqrt(fall)), f"its body falls with {fall:.2g} times gravity"
    return None


def _fall(mocap: Mocap) -> float:
    """Downward acceleration of the middle of all nodes that 1 % of the frames pass [g]."""
    if mocap.frames < 16:
        return 0.0
    height = smooth(mocap.positions.mean(axis=1)[:, 2:], 0.02 * mocap.fps)
    acceleration = np.diff(height[:, 0], 2) * mocap.fps**2
    return float(-np.percentile(acceleration[4:-4], 1)) / GRAVITY


def _nearest(rate: float) -> float:
    return min(RATES, key=lambda known: abs(np.log(known / rate)))
