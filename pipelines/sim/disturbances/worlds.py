"""What differs between disturbed worlds: the load, the slippery foot, the slope."""

from __future__ import annotations

import math
from dataclasses import replace

import mujoco
import numpy as np
import torch
from mujoco.batch import Batch

from lacoloco.datasets.rotations import rotate_inverse
from lacoloco.pipelines.sim.disturbances.config import Disturbances
from lacoloco.pipelines.sim.disturbances.randomness import grades, own_generator, spread
from lacoloco.pipelines.sim.physics import WorldParameters


class WorldChanges:
    """Drawn once for N worlds.

    Attributes:
        down: (N, 3) direction of gravity, over the floor.
    """

    def __init__(self, config: Disturbances, worlds: int, feet: int, seed: int) -> None:
        """Draw loads, feet and slopes."""
        self._config = config
        generator = own_generator(seed, 2)
        self._load = spread(config.payload, (worlds,), generator).double().numpy()
        forward, side = config.payload_place
        place = spread(1.0, (worlds, 2), generator).double() * torch.tensor([forward, side])
        self._place = torch.cat((place, torch.zeros(worlds, 1)), dim=1).numpy()
        self._foot = torch.randint(feet, (worlds,), generator=generator)
        heading = math.pi * spread(1.0, (worlds,), generator)
        tilt = config.floor_tilt * grades(config.graded, worlds, generator)
        self._steps = config.floor_steps * grades(config.graded, worlds, generator)
        self._pyramidal = grades(config.graded, worlds, generator) < 0.5
        slope = tilt.sin()
        self.down = torch.stack((slope * heading.cos(), slope * heading.sin(), -tilt.cos()), dim=1)

    def with_slippery_foot(self, parameters: WorldParameters) -> WorldParameters:
        """The parameters, one foot of each world with less friction."""
        if self._config.slippery_foot == 1.0:
            return parameters
        friction = parameters.foot_friction.clone()
        friction[torch.arange(len(friction)), self._foot] *= self._config.slippery_foot
        return replace(parameters, foot_friction=friction)

    def install(self, batch: Batch, model: mujoco.MjModel, base: int, mass: float) -> None:
        """Load the base's body, tilt gravity and set floors, after the parameters are set.

        Args:
            batch: The worlds.
            model: All of them before this.
            base: Number of the base's body.
            mass: Of the whole robot [kg].
        """
        config = self._config
        if config.floor_tilt > 0.0:
            gravity = batch.expand("opt.gravity")
            gravity[:] = np.linalg.norm(gravity, axis=1, keepdims=True) * self.down.numpy()
        if config.graded and config.floor_steps > 0.0:
            batch.expand("geom_pos")[:, model.geom("floor").id, 2] = -self._steps.numpy()
        if config.graded and config.cone == "elliptic":
            batch.expand("opt.cone")[self._pyramidal.numpy()] = mujoco.mjtCone.mjCONE_PYRAMIDAL
        if config.payload > 0.0:
            self._load_base(batch, base, self._load * mass, model.body_iquat[base])
        batch.set_const()

    def _load_base(self, batch: Batch, base: int, load: np.ndarray, axes: np.ndarray) -> None:
        """Add a mass (N,) [kg] to the base, whose principal axes ``axes`` (4,) wxyz are.

        The load is a point. It shifts the centre of mass and adds to the moments of inertia; the
        products of inertia that it adds are left out.
        """
        own = batch.expand("body_mass")[:, base].copy()
        centre = batch.expand("body_ipos")
        away = self._place - centre[:, base]
        reduced = (own * load / (own + load))[:, None]
        quat = torch.from_numpy(axes).expand(len(away), 4)
        squares = rotate_inverse(quat, torch.from_numpy(away)).square().numpy()
        moments = reduced * (squares.sum(axis=1, keepdims=True) - squares)
        centre[:, base] += (load / (own + load))[:, None] * away
        batch.expand("body_inertia")[:, base] += moments
        batch.expand("body_mass")[:, base] = own + load
