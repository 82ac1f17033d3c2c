"""When and where a dog that walks, trots and turns puts its paws.

Footfall order and duty factors are within the ranges of M. Hildebrand, "Symmetrical gaits of dogs
in relation to body build", J. Morphology 124, 1968; stride frequencies within those of N. C.
Heglund and C. R. Taylor, "Speed, stride frequency and energy cost per stride", J. Exp. Biology 138,
1988, for an animal of this size. The numbers are round ones chosen by us; nothing is fitted to
recordings. World frame: x forward at the start, y left, z up; metres, seconds, radians.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

DURATION = 12.0  # s

_TO_TROT, _TO_WALK, _CHANGE = 3.2, 7.2, 1.4  # s: the two transitions begin, and how long they take
_TURN_START, _TURN_TIME, _TURN_ANGLE = 8.8, 2.5, np.pi / 2  # s, s, rad to the left
_NODES, _NODE_WEIGHTS = np.polynomial.legendre.leggauss(24)


@dataclass(frozen=True)
class Gait:
    """One gait at one speed; `lags` are fractions of a cycle behind `phase`."""

    speed: float
    stride_rate: float
    duty: float
    """Share of the cycle in which a paw is on the ground."""
    lags: dict[str, float]
    """By leg: LH, LF, RH, RF."""


WALK = Gait(0.75, 1.4, 0.62, {"LH": 0.0, "LF": 0.25, "RH": 0.5, "RF": 0.75})
"""Lateral-sequence walk: two or three paws on the ground."""

TROT = Gait(1.6, 2.2, 0.44, {"LH": -0.125, "LF": 0.375, "RH": 0.375, "RF": 0.875})
"""Diagonal pairs, with a short flight between them. Coming from the walk, fore and hind legs each
give way by an eighth of a cycle."""


def ease(u: np.ndarray) -> np.ndarray:
    """Step from 0 to 1 over u in [0, 1], with zero velocity and acceleration at both ends."""
    u = np.clip(u, 0.0, 1.0)
    return u**3 * (10 - 15 * u + 6 * u**2)


def bump(u: np.ndarray) -> np.ndarray:
    """Rise from 0 to 1 and back over u in [0, 1], with zero velocity at both ends."""
    return np.sin(np.pi * np.clip(u, 0.0, 1.0)) ** 2


def stride(u: np.ndarray) -> np.ndarray:
    """Way of a swinging paw from 0 to 1 over u in [0, 1]; at most 1.5 times its mean speed."""
    u = np.clip(u, 0.0, 1.0)
    return u**2 * (3 - 2 * u)


def _ease_integral(u: np.ndarray) -> np.ndarray:
    v = np.clip(u, 0.0, 1.0)
    return v**4 * (2.5 - 3 * v + v**2) + np.maximum(u - 1.0, 0.0)


def trot_share(t: np.ndarray) -> np.ndarray:
    """0 while walking, 1 while trotting, between the two during a transition."""
    return ease((t - _TO_TROT) / _CHANGE) - ease((t - _TO_WALK) / _CHANGE)


def between(walk: float, trot: float, t: np.ndarray) -> np.ndarray:
    """A quantity that has one value while walking and another while trotting."""
    return walk + (trot - walk) * trot_share(t)


def _integrated(walk: float, trot: float, t: np.ndarray) -> np.ndarray:
    start = _ease_integral((t - _TO_TROT) / _CHANGE)
    stop = _ease_integral((t - _TO_WALK) / _CHANGE)
    return walk * t + (trot - walk) * _CHANGE * (start - stop)


def phase(t: np.ndarray) -> np.ndarray:
    """Cycles since the left hind paw touched down at t = 0."""
    return _integrated(WALK.stride_rate, TROT.stride_rate, t)


def leg_phase(leg: str, t: np.ndarray) -> np.ndarray:
    """Cycles of a leg; its paw touches down when this is a whole number."""
    return phase(t) - between(WALK.lags[leg], TROT.lags[leg], t)


def heading(t: np.ndarray) -> np.ndarray:
    """Direction of travel, rad from x towards y."""
    return _TURN_ANGLE * ease((t - _TURN_START) / _TURN_TIME)


def curvature(t: np.ndarray) -> np.ndarray:
    """Curvature of the path, 1/m, positive to the left."""
    u = np.clip((t - _TURN_START) / _TURN_TIME, 0.0, 1.0)
    rate = _TURN_ANGLE * 30 * u**2 * (1 - u) ** 2 / _TURN_TIME
    return rate / between(WALK.speed, TROT.speed, t)


def path(t: np.ndarray) -> np.ndarray:
    """Position (T, 2) on the path: distance covered until the turn, then the arc by quadrature."""
    straight = _integrated(WALK.speed, TROT.speed, np.minimum(t, _TURN_START))
    result = np.stack([straight, 0 * straight], axis=-1)
    for start, stop in (
        (_TURN_START, _TURN_START + _TURN_TIME),
        (_TURN_START + _TURN_TIME, np.inf),
    ):
        half = 0.5 * (np.clip(t, start, stop) - start)
        at = start + half[:, None] * (1 + _NODES)
        speed = between(WALK.speed, TROT.speed, at) * _NODE_WEIGHTS * half[:, None]
        angle = heading(at)
        result[:, 0] += (speed * np.cos(angle)).sum(1)
        result[:, 1] += (speed * np.sin(angle)).sum(1)
    return result


def footfalls(leg: str) -> tuple[np.ndarray, np.ndarray]:
    """Times of touchdown and lift-off of a leg, one each per cycle, well beyond both ends."""
    cycles = np.arange(-3, int(leg_phase(leg, np.array([DURATION]))[0]) + 4)
    down = _solve(lambda t: leg_phase(leg, t) - cycles, len(cycles))
    up = _solve(
        lambda t: leg_phase(leg, t) - cycles - between(WALK.duty, TROT.duty, t), len(cycles)
    )
    return down, up


def _solve(rising: Callable[[np.ndarray], np.ndarray], count: int) -> np.ndarray:
    """Zeros of `count` rising functions of time, by bisection to the last digit."""
    low, high = np.full(count, -10.0), np.full(count, DURATION + 10.0)
    for _ in range(70):
        middle = 0.5 * (low + high)
        above = rising(middle) > 0
        low, high = np.where(above, low, middle), np.where(above, middle, high)
    return 0.5 * (low + high)
