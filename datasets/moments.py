"""Which moments of recordings are worth learning from, and how often each is drawn.

An animal stands and looks about for a good part of a recording, and then runs faster than its robot can. A policy that is
shown both in the shares of the recording learns to stand: standing is what it can imitate at once.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import groupby

import numpy as np

from lacoloco.datasets.clip import Clip
from lacoloco.datasets.errors import DatasetError

STILL_SPEED, STILL_TURN = 0.1, 0.3
"""Below this planar speed [m/s] and turning rate [rad/s] a robot stands; it may still move a leg."""
BLUR_S, SHORTEST_S = 0.5, 0.5
"""Seconds over which speeds are averaged, and of the shortest piece that is kept."""


@dataclass(frozen=True)
class MomentConfig:
    """What is learnt from.

    Attributes:
        max_speed: planar speed beyond which a moment is left out [m/s]; 0: none is.
        still_weight: how often a moment of standing is drawn, against one of moving.
    """

    max_speed: float = 0.0
    still_weight: float = 1.0


def chosen(clips: Sequence[Clip], config: MomentConfig) -> list[Clip]:
    """The clips cut into pieces that stand and pieces that move, without those that are too fast.

    Clips come back as they are where nothing is asked for. Pieces are named after their clip and their first second.

    Raises:
        DatasetError: nothing is left.
    """
    if config == MomentConfig():
        return list(clips)
    pieces = [piece for clip in clips for piece in _pieces(clip, config)]
    if not pieces:
        raise DatasetError(
            f"moments.max_speed = {config.max_speed:g}: none of {len(clips)} clips stays below it for {SHORTEST_S:g} s"
        )
    return pieces


def _pieces(clip: Clip, config: MomentConfig) -> list[Clip]:
    speed = _blurred(np.linalg.norm(clip.root_lin_vel_b[:, :2], axis=1), clip.fps)
    turn = _blurred(np.abs(clip.root_ang_vel_b[:, 2]), clip.fps)
    still = (speed < STILL_SPEED) & (turn < STILL_TURN)
    too_fast = (speed > config.max_speed) & (config.max_speed > 0.0)
    pieces, start = [], 0
    for (stands, leaves_out), frames in groupby(zip(still, too_fast, strict=True)):
        stop = start + len(list(frames))
        if not leaves_out and stop - start > SHORTEST_S * clip.fps:
            weight = clip.weight * (config.still_weight if stands else 1.0)
            name = f"{clip.name}@{start / clip.fps:.1f}s"
            pieces.append(replace(clip.slice(start, stop), name=name, weight=weight))
        start = stop
    return pieces


def _blurred(values: np.ndarray, fps: float) -> np.ndarray:
    """(T,) means over ``BLUR_S`` around every frame; at the ends over what there is."""
    window = np.ones(max(1, round(BLUR_S * fps)))
    return np.convolve(values, window, "same") / np.convolve(np.ones_like(values), window, "same")
