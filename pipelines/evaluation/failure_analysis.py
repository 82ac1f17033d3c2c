"""Failure analysis: which parameters differ between episodes, and where failures cluster."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import TypedDict

import numpy as np
import torch

from lacoloco.datasets.rotations import rotate_inverse
from lacoloco.pipelines.sim.env import LeggedEnv

QUARTERS = 4
MIN_Z_SCORE = 4.0
"""Standard deviations above an even spread from which a cluster is not taken for chance. Some
twenty quarters are looked at in one evaluation.
"""


class FailureCluster(TypedDict):
    """A quarter of the episodes, by one parameter, that holds clearly more than a quarter of the
    failures.

    Keys: the kind of failure; the parameter and its range in that quarter; the number of failures
    in the quarter; the number of failures in all episodes.
    """

    failure: str
    parameter: str
    low: float
    high: float
    count: int
    of: int


def episode_parameters(env: LeggedEnv) -> dict[str, torch.Tensor]:
    """What differs between the N worlds of a reach task at the start of their episodes, (N,) each.

    Friction of the feet; factor on the masses; forward shift of the base's centre of mass [m];
    horizontal distance [m] and height [m] of the target; angle between the target and straight
    ahead, to either side [deg].
    """
    away = rotate_inverse(env.state.root_quat, env.command - env.state.root_pos)
    return {
        "friction": env.parameters.friction,
        "mass_scale": env.parameters.mass_scale,
        "com_forward_m": env.parameters.base_com_offset[:, 0],
        "target_distance_m": away[:, :2].norm(dim=-1),
        "target_height_m": env.command[:, 2],
        "target_angle_deg": torch.atan2(away[:, 1], away[:, 0]).abs().rad2deg(),
    }


def failure_clusters(
    failures: Mapping[str, np.ndarray], parameters: Mapping[str, np.ndarray]
) -> list[FailureCluster]:
    """Find where failures cluster.

    Args:
        failures: Kind of failure -> (E,) bool.
        parameters: Name of the parameter -> (E,) values.

    Returns:
        For each failure and parameter at most one cluster; none where failures are spread as
        chance spreads them.
    """
    clusters = []
    for failure, failed in failures.items():
        for parameter, values in parameters.items():
            cluster = _cluster(failure, failed, parameter, values)
            if cluster is not None:
                clusters.append(cluster)
    return clusters


def describe(cluster: FailureCluster) -> str:
    """One line for a person."""
    largest = max(abs(cluster["low"]), abs(cluster["high"]), 1e-9)
    digits = max(0, 2 - math.floor(math.log10(largest)))
    low, high = f"{cluster['low']:.{digits}f}", f"{cluster['high']:.{digits}f}"
    return (
        f"{cluster['failure']}: {cluster['count']} of {cluster['of']} in the quarter with "
        f"{cluster['parameter']} {low} to {high}"
    )


def _cluster(
    failure: str, failed: np.ndarray, parameter: str, values: np.ndarray
) -> FailureCluster | None:
    """The quarter with the most failures beyond chance, if they are clearly more."""
    edges = np.quantile(values, np.linspace(0.0, 1.0, QUARTERS + 1))
    quarter = np.clip(np.searchsorted(edges, values, side="right") - 1, 0, QUARTERS - 1)
    counts = np.bincount(quarter[failed], minlength=QUARTERS)
    shares = np.bincount(quarter, minlength=QUARTERS) / len(values)
    z_scores = _z_scores(counts, shares)
    worst = int(z_scores.argmax())
    if z_scores[worst] <= MIN_Z_SCORE:
        return None
    return FailureCluster(
        failure=failure,
        parameter=parameter,
        low=float(edges[worst]),
        high=float(edges[worst + 1]),
        count=int(counts[worst]),
        of=int(counts.sum()),
    )


def _z_scores(counts: np.ndarray, shares: np.ndarray) -> np.ndarray:
    """(Q,) excess of the ``counts`` (Q,) over what chance gives bins with ``shares`` (Q,) of all
    episodes, in standard deviations of the binomial distribution.
    """
    total = int(counts.sum())
    variance = np.maximum(total * shares * (1 - shares), 1e-9)
    return (counts - total * shares) / np.sqrt(variance)
