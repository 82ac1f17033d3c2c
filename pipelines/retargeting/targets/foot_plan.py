"""Where the feet of a clip go: planted where the animal's paws stand, smoothly onward between."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lacoloco.pipelines.retargeting.targets.contacts import phases

BLEND = 0.2
"""s at each end of a swing over which it is bent towards where the foot stands."""
CLEARANCE = 0.01
"""m of air below a foot in the middle of its swing."""


@dataclass(frozen=True)
class FootPlan:
    """Paths of F feet, or points of feet, (centres of their spheres) over T frames."""

    path: np.ndarray
    """(T, F, 3) world, m; constant while a foot stands."""
    stands: np.ndarray
    """(T, F) bool."""
    floor: np.ndarray
    """(T, F) least height, m."""


def plan_feet(
    feet: np.ndarray,
    contacts: np.ndarray,
    radius: float,
    fps: float,
    prints: np.ndarray | None = None,
) -> FootPlan:
    """Plant the feet, and bend each swing so that it begins and ends at rest on the ground.

    While a paw stands, its foot stays at the mean of its footprints. The swing keeps its shape,
    plus a cubic at either end that takes away the jump in place and in velocity.

    Args:
        feet: (T, F, 3) targets of the centres, m.
        contacts: (T, F) bool, which paws stand.
        radius: Of the foot spheres, m.
        fps: Frames per second.
        prints: (T, F, 2) where feet would stand, m; default: at their targets.
    """
    prints = feet[..., :2] if prints is None else prints
    path, floor = feet.copy(), np.full(feet.shape[:2], radius)
    standing = phases(contacts)
    for foot, start, stop in standing:
        path[start:stop, foot] = [*prints[start:stop, foot].mean(0), radius]
    velocity = np.gradient(feet, axis=0) if len(feet) > 1 else np.zeros_like(feet)
    for foot, start, stop in phases(~contacts):
        reach = max(min(BLEND * fps, (stop - start + 1) / 2), 2.0)
        frames = np.arange(start, stop)
        if start > 0:
            lift = start - 1
            jump = path[lift, foot] - feet[lift, foot]
            path[start:stop, foot] += _bend(
                (frames - lift) / reach, jump, -reach * velocity[lift, foot]
            )
        if stop < len(feet):
            jump = path[stop, foot] - feet[stop, foot]
            path[start:stop, foot] += _bend(
                (stop - frames) / reach, jump, reach * velocity[stop, foot]
            )
        phase = (frames - start + 1) / (stop - start + 1)
        floor[start:stop, foot] += CLEARANCE * np.sin(np.pi * phase) ** 2
    path[..., 2] = np.maximum(path[..., 2], floor)
    return FootPlan(path, contacts, floor)


def footprints(feet: np.ndarray, contacts: np.ndarray) -> np.ndarray:
    """Where heels and toes stand, (T, F, 2) m: as far from each other as they are on one foot.

    From the first to the last touch of a foot it stands in one place: where it is on average while
    heel and toes stand, else where that which stands is.

    Args:
        feet: (T, F, 3) targets of heel and toes of one foot after the other, m.
        contacts: (T, F) bool.
    """
    prints = feet[..., :2].copy()
    for heel in range(0, feet.shape[1], 2):
        pair = slice(heel, heel + 2)
        length = float(np.median(np.linalg.norm(feet[:, heel + 1] - feet[:, heel], axis=-1)))
        touching = contacts[:, heel : heel + 1] | contacts[:, heel + 1 : heel + 2]
        for _, start, stop in phases(touching):
            flat = contacts[start:stop, pair].all(axis=1)
            if flat.any():
                back, front = prints[start:stop, pair][flat].mean(0)
                half = 0.5 * length * (front - back) / max(np.linalg.norm(front - back), 1e-9)
                middle = 0.5 * (back + front)
                prints[start:stop, pair] = middle - half, middle + half
    return prints


def _bend(progress: np.ndarray, value: np.ndarray, slope: np.ndarray) -> np.ndarray:
    """Cubic (n, 3) with this value and slope at progress 0, and neither from progress 1 on."""
    x = np.clip(progress, 0.0, 1.0)[:, None]
    return (2 * x**3 - 3 * x**2 + 1) * value + (x**3 - 2 * x**2 + x) * slope
