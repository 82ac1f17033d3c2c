"""95 % intervals: of one policy's metrics over its episodes, of a method's over its seeds."""

from __future__ import annotations

import math
import statistics
from collections.abc import Callable, Sequence

import numpy as np

RESAMPLES = 1000
BOOTSTRAP_SEED = 4_000_037
"""Of the resampling, so that the same episodes always give the same interval."""
LEVEL = 0.95
_CHUNK = 64
"""Resamples at once: 64 x 4096 episodes are 2 MB per array."""
T_QUANTILES = (
    *(12.706, 4.303, 3.182, 2.776, 2.571, 2.447, 2.365, 2.306, 2.262, 2.228),
    *(2.201, 2.179, 2.160, 2.145, 2.131, 2.120, 2.110, 2.101, 2.093, 2.086),
    *(2.080, 2.074, 2.069, 2.064, 2.060, 2.056, 2.052, 2.048, 2.045, 2.042),
)
"""97.5 % quantiles of Student's t with 1, 2, ... 30 degrees of freedom."""

Estimator = Callable[[np.ndarray], np.ndarray]
"""Numbers (R, E) of the episodes that R resamples hold -> (R,) values of a metric."""


def bootstrap(
    estimators: dict[str, Estimator], episodes: int, seed: int = BOOTSTRAP_SEED
) -> dict[str, list[float]]:
    """Percentile intervals of metrics over E episodes, from resampling the episodes.

    Args:
        estimators: Name -> metric.
        episodes: E.
        seed: Of the resampling.

    Returns:
        Name -> [low, high].
    """
    generator = np.random.default_rng(seed)
    values: dict[str, list[np.ndarray]] = {name: [] for name in estimators}
    for start in range(0, RESAMPLES, _CHUNK):
        rows = min(_CHUNK, RESAMPLES - start)
        chosen = generator.integers(episodes, size=(rows, episodes))
        for name, estimate in estimators.items():
            values[name].append(estimate(chosen))
    tails = ((1.0 - LEVEL) / 2.0, (1.0 + LEVEL) / 2.0)
    found = {}
    for name, parts in values.items():
        known = np.concatenate(parts)
        known = known[~np.isnan(known)]  # a resample may hold no episode that has the metric
        edges = np.quantile(known, tails) if len(known) else (math.nan, math.nan)
        found[name] = [float(edge) for edge in edges]
    return found


def unanimous(all_of_them: bool, episodes: int) -> list[float]:
    """Exact binomial interval [%] of a share that is 0 or all of the episodes, where resampling
    sees no spread (Clopper and Pearson, 1934).
    """
    edge = 100.0 * ((1.0 - LEVEL) / 2.0) ** (1.0 / episodes)
    return [edge, 100.0] if all_of_them else [0.0, 100.0 - edge]


def over_seeds(
    values: Sequence[float], within: tuple[float, float] = (-math.inf, math.inf)
) -> list[float] | None:
    """Student's interval [low, high] of the mean over seeds, cut to where the metric can lie; None
    for a single one.
    """
    if len(values) < 2:
        return None
    mean, half = statistics.fmean(values), t_quantile(len(values) - 1)
    half *= statistics.stdev(values) / math.sqrt(len(values))
    return [max(within[0], mean - half), min(within[1], mean + half)]


def t_quantile(degrees: int) -> float:
    """97.5 % quantile of Student's t, to a thousandth."""
    if degrees <= len(T_QUANTILES):
        return T_QUANTILES[degrees - 1]
    normal = statistics.NormalDist().inv_cdf((1.0 + LEVEL) / 2.0)
    first = (normal**3 + normal) / 4.0  # the first two terms of Fisher's expansion
    second = (5.0 * normal**5 + 16.0 * normal**3 + 3.0 * normal) / 96.0
    return normal + first / degrees + second / degrees**2
