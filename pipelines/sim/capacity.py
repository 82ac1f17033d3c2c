"""How many contacts and constraint rows a robot can need, found by throwing it at the floor in many
poses.
"""

from __future__ import annotations

import os
from dataclasses import dataclass

import mujoco
import numpy as np

from lacoloco.pipelines.errors import StageError

POSES = 256
MARGIN = 1.5
CONTACTS, CONSTRAINTS = "LACOLOCO_WARP_NCONMAX", "LACOLOCO_WARP_NJMAX"
"""Environment variables that override what was found."""


@dataclass(frozen=True)
class Capacity:
    """Room for ``contacts`` (a mean: all worlds share one pool) and ``constraints`` rows (a hard
    limit) per world.
    """

    contacts: int
    constraints: int

    def refuse(self, *, contacts: bool) -> StageError:
        """The error to raise when one of the two ran out: it names the number to raise."""
        name, size = (CONTACTS, self.contacts) if contacts else (CONSTRAINTS, self.constraints)
        what = "contacts" if contacts else "constraint rows"
        return StageError(f"MuJoCo Warp ran out of {what}, {size} per world: set {name}={2 * size}")


def find_capacity(model: mujoco.MjModel, seed: int = 0) -> Capacity:
    """Probe a model of a robot and a floor with random poses at random heights, joints also beyond
    their limits.

    Contacts and constraint rows are counted by the C engine, whose collision functions Warp ports;
    half as much again is added to the worst count.

    Raises:
        StageError: an override is not a positive whole number.
    """
    generator, data = np.random.default_rng(seed), mujoco.MjData(model)
    lower, upper = model.jnt_range[1:].T
    reach = model.stat.extent
    contacts = constraints = 1
    for _ in range(POSES):
        data.qpos[:3] = 0.0, 0.0, generator.uniform(0.0, 0.5 * reach)
        data.qpos[3:7] = generator.normal(size=4)
        data.qpos[7:] = generator.uniform(lower - 0.1, upper + 0.1)
        mujoco.mj_normalizeQuat(model, data.qpos)
        mujoco.mj_fwdPosition(model, data)
        contacts, constraints = max(contacts, data.ncon), max(constraints, data.nefc)
    return Capacity(
        _override(CONTACTS, _room(contacts)), _override(CONSTRAINTS, _room(constraints))
    )


def _room(count: int) -> int:
    return 8 * int(np.ceil(MARGIN * count / 8))


def _override(name: str, found: int) -> int:
    text = os.environ.get(name)
    if text is None:
        return found
    if not text.isdecimal() or int(text) < 1:
        raise StageError(f"{name}={text}: give a positive whole number, or unset it for {found}")
    return int(text)
