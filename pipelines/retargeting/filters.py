"""Zero-phase filters over time (axis 0); the ends are held."""

from __future__ import annotations

import numpy as np


def smooth(series: np.ndarray, sigma: float) -> np.ndarray:
    """Gaussian average of a series (T, ...).

    Args:
        series: Values.
        sigma: Standard deviation, frames; 0 returns the series.
    """
    reach = int(np.ceil(3 * sigma))
    if reach == 0:
        return series
    weights = np.exp(-0.5 * (np.arange(-reach, reach + 1) / sigma) ** 2)
    return _windows(series, reach) @ (weights / weights.sum())


def lower_envelope(series: np.ndarray, reach: int) -> np.ndarray:
    """Smooth curve (T,) that nowhere exceeds the series and follows its valleys.

    The least value within `reach` frames, averaged with weights that vanish beyond `reach` frames:
    every averaged value is at most the series in the middle, so their average is, too.
    """
    least = _windows(series, reach).min(-1)
    weights = np.hanning(2 * reach + 3)[1:-1]
    return _windows(least, reach) @ (weights / weights.sum())


def _windows(series: np.ndarray, reach: int) -> np.ndarray:
    """(T, ..., 2 reach + 1): what lies around each frame, without copies."""
    padding = [(reach, reach)] + [(0, 0)] * (series.ndim - 1)
    padded = np.pad(series, padding, mode="edge")
    return np.lib.stride_tricks.sliding_window_view(padded, 2 * reach + 1, axis=0)
