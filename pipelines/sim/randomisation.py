"""What differs between worlds, and by how much."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Annotated

import torch

from lacoloco.pipelines.sim.commands import uniform
from lacoloco.pipelines.sim.physics import WorldParameters
from lacoloco.robots.tables import NonNegative, Range, Rule

Softer = Annotated[Range, Rule("numbers of at least 1", lambda pair: pair[0] >= 1)]


@dataclass(frozen=True)
class Randomisation:
    """What differs between worlds (``LeggedEnv.redraw`` draws it again) and how hard the base is
    pushed.

    Attributes:
        friction: Of the feet.
        foot_friction: Further factor on it, foot by foot.
        contact_time: Factor on the time constant of the feet's contacts; stiffness goes with its
            inverse square. Nothing stiffer than 1 is stable.
        contact_damping: Damping ratio of the feet's contacts; stiffness goes with its inverse
            square, too.
        mass_scale: Factor on all masses.
        inertia_scale: Factor on all inertias.
        base_com: Half-range of each component of the shift of the base's centre of mass [m].
        push: Half-range of each component that a push adds to the base's velocity [m/s, rad/s].
        push_interval_s: Seconds between pushes.
    """

    friction: Range = (0.4, 1.5)
    foot_friction: Range = (0.9, 1.1)
    contact_time: Softer = (1.0, 1.5)
    contact_damping: Range = (0.7, 1.2)
    mass_scale: Range = (0.8, 1.2)
    inertia_scale: Range = (0.8, 1.2)
    base_com: NonNegative = 0.02
    push: NonNegative = 0.1
    push_interval_s: Range = (5.0, 8.0)


SAME = (1.0, 1.0)
NO_RANDOMISATION = Randomisation(SAME, SAME, SAME, SAME, SAME, SAME, 0.0, 0.0)


def widened(randomisation: Randomisation, factor: float) -> Randomisation:
    """The same with masses, inertias, centre of mass and pushes spread ``factor`` times as far,
    friction and contacts as ratios.

    A policy trained a little beyond what it will meet has met the edge of that more than once in a
    thousand falls: a heavy robot on a floor that does not let its feet slip, above all.
    """
    scales = (randomisation.mass_scale, randomisation.inertia_scale)
    around = [(1.0 + factor * (low - 1.0), 1.0 + factor * (high - 1.0)) for low, high in scales]
    softest = randomisation.contact_time[1] ** factor
    return replace(
        randomisation,
        friction=_widened_ratio(randomisation.friction, factor),
        foot_friction=_widened_ratio(randomisation.foot_friction, factor),
        contact_time=(randomisation.contact_time[0], softest),
        contact_damping=_widened_ratio(randomisation.contact_damping, factor),
        mass_scale=around[0],
        inertia_scale=around[1],
        base_com=factor * randomisation.base_com,
        push=factor * randomisation.push,
    )


def _widened_ratio(span: Range, factor: float) -> Range:
    low, high = span
    middle, ratio = math.sqrt(low * high), math.sqrt(high / low) ** factor
    return middle / ratio, middle * ratio


def draw_parameters(
    config: Randomisation, count: int, feet: int, generator: torch.Generator
) -> WorldParameters:
    """Independent uniform parameters for ``count`` worlds of a robot with so many feet."""
    com = config.base_com
    ranges = (
        config.friction,
        config.mass_scale,
        config.inertia_scale,
        config.contact_time,
        config.contact_damping,
        *((-com, com),) * 3,
        *(config.foot_friction,) * feet,
    )
    columns = uniform(ranges, count, generator)
    friction, mass, inertia, time, damping = columns[:, :5].unbind(dim=1)
    return WorldParameters(
        friction=friction,
        foot_friction=columns[:, 8:],
        contact_time=time,
        contact_damping=damping,
        mass_scale=mass,
        inertia_scale=inertia,
        base_com_offset=columns[:, 5:8],
    )
