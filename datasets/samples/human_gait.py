"""When, where and how a person who walks and turns puts the feet.

Timing and angles are round ones within textbook ranges (M. W. Whittle, "Gait Analysis: An
Introduction", 4th ed., 2007: cycle 0.9 to 1.3 s, stance 60 % of it, heel off at 30 to 40 %, foot
pitched by 20 degrees at heel strike); nothing is fitted to recordings. World frame: x forward at
the start, y left, z up; metres, seconds, radians.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lacoloco.datasets.samples.gait import bump, ease, stride

DURATION = 10.0  # s
SPEED = 1.0  # m/s
CYCLE = 1.15  # s, two steps
STANCE, FLAT, HEEL_OFF = 0.62, 0.10, 0.36  # shares of the cycle after heel strike
MIDDLE = 0.29  # share of the cycle at which the ankle passes below the hip
LAGS = {"Left": 0.0, "Right": 0.5}  # shares of the cycle

ANKLE = 0.09  # m above the sole
HEEL = 0.05  # m behind the ankle
BALL = (0.14, 0.02)  # m: the joint of the toes ahead of the ankle, and above the sole
ASIDE = 0.09  # m from the middle of the body
STRIKE, PUSH = 0.35, 0.8  # rad: toes up at heel strike, heel up at toe off
LIFT = 0.03  # m added to the ankle's way in swing

_TURN_START, _TURN_TIME, _TURN_ANGLE = 4.5, 3.5, np.pi / 2  # s, s, rad to the left
_NODES, _NODE_WEIGHTS = np.polynomial.legendre.leggauss(32)


@dataclass(frozen=True)
class FootPose:
    """One foot at T times."""

    ankle: np.ndarray
    """(T, 3) m."""
    yaw: np.ndarray
    """(T,) rad, where it points."""
    pitch: np.ndarray
    """(T,) rad, positive with the toes up."""
    toes: np.ndarray
    """(T,) rad, pitch of the toes."""


def phase(t: np.ndarray) -> np.ndarray:
    """Cycles since the left heel struck at t = 0."""
    return t / CYCLE


def heading(t: np.ndarray) -> np.ndarray:
    """Direction of travel, rad from x towards y."""
    return _TURN_ANGLE * ease((t - _TURN_START) / _TURN_TIME)


def path(t: np.ndarray) -> np.ndarray:
    """Position (T, 2): straight, an arc by quadrature, straight again."""
    start = np.minimum(t, _TURN_START)
    result = SPEED * np.stack([start, 0 * start], axis=-1)
    ends = (_TURN_START, _TURN_START + _TURN_TIME, np.inf)
    for low, high in zip(ends[:-1], ends[1:], strict=True):
        half = 0.5 * (np.clip(t, low, high) - low)
        angle = heading(low + half[:, None] * (1 + _NODES))
        way = SPEED * _NODE_WEIGHTS * half[:, None]
        result += np.stack([(way * np.cos(angle)).sum(1), (way * np.sin(angle)).sum(1)], axis=-1)
    return result


def heel_strikes(side: str) -> np.ndarray:
    """Times at which a heel strikes, well beyond both ends."""
    return CYCLE * (np.arange(-2, int(DURATION / CYCLE) + 4) + LAGS[side])


def stance(side: str, t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Whether heel and ball of a foot stand at t: bool (T,) each."""
    share = _share(side, t)[1]
    return share < HEEL_OFF, (share >= FLAT) & (share < STANCE)


def foot(side: str, t: np.ndarray) -> FootPose:
    """A foot that rolls over its heel, stands flat, rolls over its ball, and swings."""
    index, share = _share(side, t)
    prints, yaws = _prints(side)
    swing = np.clip((share - STANCE) / (1 - STANCE), 0.0, 1.0)
    ahead, up, pitch = _stance_pose(share)
    standing = _placed(prints[index], yaws[index], ahead, up)
    # The swing leaves with the velocity of the push and arrives at rest.
    first = _placed(prints[index], yaws[index], *_stance_pose(np.full_like(t, STANCE))[:2])
    last = _placed(prints[index + 1], yaws[index + 1], *_stance_pose(np.zeros_like(t))[:2])
    small = 1e-5
    before = _placed(prints[index], yaws[index], *_stance_pose(np.full_like(t, STANCE - small))[:2])
    leaving = (first - before) / small * (1 - STANCE)
    flying = _hermite(swing, first, last, leaving)
    flying[:, 2] += LIFT * bump(swing)
    turned = yaws[index] + stride(swing) * (yaws[index + 1] - yaws[index])
    tilt = -PUSH + (PUSH + STRIKE) * ease(swing)
    on_ground = share < STANCE
    return FootPose(
        ankle=np.where(on_ground[:, None], standing, flying),
        yaw=np.where(on_ground, yaws[index], turned),
        pitch=np.where(on_ground, pitch, tilt),
        toes=np.where(on_ground, np.maximum(pitch, 0.0), STRIKE * ease(swing)),
    )


def _share(side: str, t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Number of the last heel strike, and the share of the cycle since then."""
    strikes = heel_strikes(side)
    index = np.searchsorted(strikes, t + 1e-9, side="right") - 1
    return index, np.maximum(t - strikes[index], 0.0) / CYCLE


def _prints(side: str) -> tuple[np.ndarray, np.ndarray]:
    """Where (n, 2) the ankle stands above the sole, and where (n,) the foot points."""
    middle = heel_strikes(side) + MIDDLE * CYCLE
    angle = heading(middle)
    left = np.stack([-np.sin(angle), np.cos(angle)], axis=-1)
    return path(middle) + (ASIDE if side == "Left" else -ASIDE) * left, angle


def _stance_pose(share: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The ankle ahead of where it stands, its height, and the pitch of the foot."""
    strike = STRIKE * (1 - ease(share / FLAT))
    push = PUSH * np.clip((share - HEEL_OFF) / (STANCE - HEEL_OFF), 0.0, 1.0) ** 2
    about_heel = _turned(HEEL, ANKLE, strike)
    about_ball = _turned(-BALL[0], ANKLE - BALL[1], -push)
    early = share < HEEL_OFF
    ahead = np.where(early, about_heel[0] - HEEL, about_ball[0] + BALL[0])
    return ahead, np.where(early, about_heel[1], about_ball[1] + BALL[1]), strike - push


def _turned(ahead: float, up: float, pitch: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    cos, sin = np.cos(pitch), np.sin(pitch)
    return cos * ahead - sin * up, sin * ahead + cos * up


def _placed(place: np.ndarray, yaw: np.ndarray, ahead: np.ndarray, up: np.ndarray) -> np.ndarray:
    way = np.stack([np.cos(yaw), np.sin(yaw)], axis=-1) * ahead[:, None]
    return np.column_stack([place + way, up])


def _hermite(u: np.ndarray, first: np.ndarray, last: np.ndarray, leaving: np.ndarray) -> np.ndarray:
    """Cubic (T, 3) from `first` with slope `leaving` to `last` with slope 0, u from 0 to 1."""
    x = u[:, None]
    share = x**2 * (3 - 2 * x)
    return first + share * (last - first) + x * (1 - x) ** 2 * leaving
