"""Orientations between the frames of clips, computed once for all frames."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor

import numpy as np

from lacoloco.datasets.hashing import available_cores

COLUMNS = 9
"""Numbers of a row: q, e and the angle."""
_CHUNK = 1 << 12
"""Rows at a time: their numbers in double precision stay in the cache of a core."""


def great_circles(quat: np.ndarray, offsets: np.ndarray) -> np.ndarray:
    """Rows (N, 9) of q, e, angle, with slerp(q_k, q_k+1, s) = cos(s angle) q_k + sin(s angle) e_k.

    q_k and the unit quaternion e_k, at right angles to it, span the great circle to q_k+1. The
    last frame of a clip leads nowhere: its e and angle are zero.

    Args:
        quat: (N, 4) of all clips one after the other; signs may flip between frames.
        offsets: (clips + 1,) where each clip begins.

    Returns:
        float32, from numbers computed in double precision.
    """
    rows = np.empty((len(quat), COLUMNS), dtype=np.float32)
    edges = offsets[np.unique(np.searchsorted(offsets, np.arange(0, len(quat), _CHUNK)))]
    edges = np.unique(np.append(edges, len(quat)))

    def fill(start: int, stop: int) -> None:
        first, last = np.searchsorted(offsets, start, "right"), np.searchsorted(offsets, stop)
        inside = offsets[first:last] - start
        rows[start:stop] = _circles(quat[start:stop].astype(np.float64), inside)

    with ThreadPoolExecutor(available_cores()) as pool:
        list(pool.map(fill, edges[:-1].tolist(), edges[1:].tolist()))
    return rows


def _circles(quat: np.ndarray, starts: np.ndarray) -> np.ndarray:
    """The rows of whole clips, of which all but the first begin at `starts`."""
    parts = quat.T.copy()  # one component after the other: sums of four are slow in NumPy
    parts /= np.sqrt(_dot(parts, parts))
    _make_continuous(parts, starts)
    start, end = parts[:, :-1], parts[:, 1:]
    aside = end - _dot(start, end) * start
    sine = np.sqrt(_dot(aside, aside))
    circles = np.zeros((COLUMNS, parts.shape[1]))
    circles[:4] = parts
    circles[4:8, :-1] = aside / np.maximum(sine, 1e-12)
    circles[8, :-1] = np.arcsin(np.minimum(sine, 1.0))
    circles[4:, starts - 1] = 0.0
    return circles.T


def _make_continuous(parts: np.ndarray, starts: np.ndarray) -> None:
    """Choose signs in place such that neighbours of one clip lie in one hemisphere."""
    flips = _dot(parts[:, 1:], parts[:, :-1]) < 0
    flips[starts - 1] = False
    if not flips.any():
        return
    count = np.concatenate([[0], np.cumsum(flips)])
    begin = np.zeros(parts.shape[1], dtype=np.int64)
    begin[starts] = starts
    odd = (count - count[np.maximum.accumulate(begin)]) % 2 == 1
    parts[:, odd] *= -1.0


def _dot(one: np.ndarray, other: np.ndarray) -> np.ndarray:
    """Sum (n,) over four components, first to last, so that no grouping changes the last digit."""
    product = one * other
    return ((product[0] + product[1]) + product[2]) + product[3]
