"""When the paws of the animal stand on the ground, from where they are and how fast."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lacoloco.pipelines.retargeting.filters import smooth


@dataclass(frozen=True)
class ContactRule:
    """Two thresholds per quantity: a paw must be well inside to land, and well outside to lift off.

    Speeds count relative to the animal's own where that is larger: a paw that has landed still
    rolls and slips in a gallop.
    """

    land_height: float = 0.025
    """m above where the paw stands."""
    lift_height: float = 0.035
    land_speed: float = 0.25
    """m/s."""
    lift_speed: float = 0.4
    land_speed_share: float = 0.25
    """Times the speed of the animal."""
    lift_speed_share: float = 0.35
    shortest_contact: float = 0.03
    """s; a shorter touch is none."""
    shortest_swing: float = 0.05
    """s; a shorter gap between contacts of one paw is closed."""
    ground_spread: float = 0.03
    """m by which the paws may differ in the height at which they stand: their markers do."""


def detect_contacts(
    paws: np.ndarray, root: np.ndarray, fps: float, rule: ContactRule
) -> np.ndarray:
    """Tell for each paw and frame whether it stands.

    Args:
        paws: (T, F, 3) world, m, the lowest points of the limbs.
        root: (T, 3) world, m.
        fps: Frames per second.
        rule: Thresholds.

    Returns:
        (T, F) bool.
    """
    if len(paws) < 2:
        return paws[..., 2] - stance_heights(paws, rule) < rule.land_height
    speed = np.linalg.norm(smooth(np.gradient(paws, 1 / fps, axis=0), 0.015 * fps), axis=-1)
    travel = smooth(np.gradient(root[:, :2], 1 / fps, axis=0), 0.2 * fps)
    pace = np.linalg.norm(travel, axis=-1)[:, None]
    height = paws[..., 2] - stance_heights(paws, rule)
    land = height < rule.land_height
    land &= speed < np.maximum(rule.land_speed, rule.land_speed_share * pace)
    stay = height < rule.lift_height
    stay &= speed < np.maximum(rule.lift_speed, rule.lift_speed_share * pace)
    contacts = _runs_with(stay | land, land)
    contacts = ~_without_short(~contacts, rule.shortest_swing * fps)
    return _without_short(contacts, rule.shortest_contact * fps)


def stance_heights(paws: np.ndarray, rule: ContactRule) -> np.ndarray:
    """Height (F,) of each paw's marker when it stands, m: its lowest, within reason of the others'.

    A paw that never comes down in the clip must not make its own ground in the air.
    """
    lowest = np.percentile(paws[..., 2], 2, axis=0)
    common = np.median(lowest)
    return np.clip(lowest, common - rule.ground_spread, common + rule.ground_spread)


def phases(contacts: np.ndarray) -> list[tuple[int, int, int]]:
    """Contact phases (paw, first frame, frame after the last) of (T, F) bool, paw by paw."""
    found = []
    for paw, column in enumerate(contacts.T):
        edges = np.flatnonzero(np.diff(np.concatenate([[0], column, [0]]).astype(int)))
        found += [(paw, int(a), int(b)) for a, b in edges.reshape(-1, 2)]
    return found


def _runs_with(mask: np.ndarray, core: np.ndarray) -> np.ndarray:
    """Those runs of `mask` over time that hold at least one frame of `core`: hysteresis."""
    kept = np.zeros_like(mask)
    for paw, start, stop in phases(mask):
        kept[start:stop, paw] = core[start:stop, paw].any()
    return kept


def _without_short(mask: np.ndarray, shortest: float) -> np.ndarray:
    """Mask without runs of fewer frames than `shortest`; runs cut off by an end stay."""
    kept = mask.copy()
    for paw, start, stop in phases(mask):
        whole = start > 0 and stop < len(mask)
        if whole and stop - start < shortest:
            kept[start:stop, paw] = False
    return kept
