"""What differs between worlds, and by how much."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import torch

from lacoloco.pipelines.sim.commands import uniform
from lacoloco.pipelines.sim.physics import WorldParameters
from lacoloco.robots.tables import NonNegative, Range


@dataclass(frozen=True)
class Randomisation:
    """What differs between worlds (``LeggedEnv.redraw`` draws it again) and how hard the base is
    pushed.

    Attributes:
        friction: Of the feet.
        mass_scale: Factor on all masses.
        inertia_scale: Factor on all inertias.
        base_com: Half-range of each component of the shift of the base's centre of mass [m].
        push: Half-range of each component that a push adds to the base's velocity [m/s, rad/s].
        push_interval_s: Seconds between pushes.
    """

    friction: Range = (0.4, 1.5)
    mass_scale: Range = (0.8, 1.2)
    inertia_scale: Range = (0.8, 1.2)
    base_com: NonNegative = 0.02
    push: NonNegative = 0.1
    push_interval_s: Range = (5.0, 8.0)


NO_RANDOMISATION = Randomisation((1.0, 1.0), (1.0, 1.0), (1.0, 1.0), 0.0, 0.0)


def widened(randomisation: Randomisation, factor: float) -> Randomisation:
    """The same with masses, inertias, centre of mass and pushes spread ``factor`` times as far,
    friction as a ratio.

    A policy trained a little beyond what it will meet has met the edge of that more than once in a
    thousand falls: a heavy robot on a floor that does not let its feet slip, above all.
    """
    scales = (randomisation.mass_scale, randomisation.inertia_scale)
    around = [(1.0 + factor * (low - 1.0), 1.0 + factor * (high - 1.0)) for low, high in scales]
    low, high = randomisation.friction
    middle, ratio = math.sqrt(low * high), math.sqrt(high / low) ** factor
    return replace(
        randomisation,
        friction=(middle / ratio, middle * ratio),
        mass_scale=around[0],
        inertia_scale=around[1],
        base_com=factor * randomisation.base_com,
        push=factor * randomisation.push,
    )


def draw_parameters(config: Randomisation, count: int, draw: torch.Generator) -> WorldParameters:
    """Independent uniform parameters for ``count`` worlds."""
    com = config.base_com
    ranges = (config.friction, config.mass_scale, config.inertia_scale, *((-com, com),) * 3)
    columns = uniform(ranges, count, draw)
    return WorldParameters(columns[:, 0], columns[:, 1], columns[:, 2], columns[:, 3:6])
