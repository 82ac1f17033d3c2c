"""Under which conditions episodes fail: what differed between them, and where their falls and
misses crowd together.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import TypedDict

import numpy as np
import torch

from lacoloco.datasets.rotations import rotate_inverse
from lacoloco.pipelines.sim.env import LeggedEnv

QUARTERS = 4
CLEARLY = 4.0
"""Standard deviations above an even spread from which a crowd is none of chance, with some twenty
quarters looked at.
"""


class Crowd(TypedDict):
    """A quarter of the episodes in which one kind of failure crowds.

    Which failure, the condition and its range in that quarter, and how many of how many failures
    are there.
    """

    failure: str
    condition: str
    low: float
    high: float
    count: int
    of: int


def conditions(env: LeggedEnv) -> dict[str, torch.Tensor]:
    """What differs between the N worlds of a reach task at the start of their episodes, (N,) each.

    Friction of the feet, factor on the masses, how far forward the base's centre of mass is shifted
    [m]; horizontal distance [m] and height [m] of the target, and its angle to either side of
    straight ahead [deg].
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


def crowds(failures: Mapping[str, np.ndarray], given: Mapping[str, np.ndarray]) -> list[Crowd]:
    """Where failures crowd: the quarters of a condition that hold clearly more of them than a
    quarter.

    Args:
        failures: kind of failure -> (E,) bool.
        given: condition -> (E,) values.

    Returns:
        For each failure and condition at most the fullest quarter; nothing where failures are
        spread as chance spreads them.
    """
    found: list[Crowd] = []
    for failure, failed in failures.items():
        total = int(failed.sum())
        for condition, values in given.items():
            edges = np.quantile(values, np.linspace(0.0, 1.0, QUARTERS + 1))
            quarter = np.clip(np.searchsorted(edges, values, side="right") - 1, 0, QUARTERS - 1)
            counts = np.bincount(quarter[failed], minlength=QUARTERS)
            sizes = np.bincount(quarter, minlength=QUARTERS) / len(values)
            excess = (counts - total * sizes) / np.sqrt(
                np.maximum(total * sizes * (1 - sizes), 1e-9)
            )
            worst = int(excess.argmax())
            if excess[worst] > CLEARLY:
                low, high = edges[worst : worst + 2]
                found.append(
                    Crowd(
                        failure=failure,
                        condition=condition,
                        low=float(low),
                        high=float(high),
                        count=int(counts[worst]),
                        of=total,
                    )
                )
    return found


def describe(crowd: Crowd) -> str:
    """One line for a person."""
    digits = max(0, 2 - math.floor(math.log10(max(abs(crowd["low"]), abs(crowd["high"]), 1e-9))))
    low, high = (f"{crowd[end]:.{digits}f}" for end in ("low", "high"))
    return (
        f"{crowd['failure']}: {crowd['count']} of {crowd['of']} in the quarter with "
        f"{crowd['condition']} {low} to {high}"
    )
