"""Observations and actions as the mirrored robot would have them."""

from __future__ import annotations

import torch

from lacoloco.pipelines.sim.state import Term
from lacoloco.robots.spec import RobotSpec
from lacoloco.robots.symmetry import sagittal_symmetry

ARROW = (1.0, -1.0, 1.0)
TURN = (-1.0, 1.0, -1.0)
SIGNS = {
    "base_height": (1.0,),
    "projected_gravity": ARROW,
    "base_lin_vel": ARROW,
    "base_ang_vel": TURN,
    "velocity_command": (1.0, -1.0, -1.0),  # forward, lateral, yaw rate
    "target": ARROW,
    "heading_command": ARROW,
    "height_command": (1.0,),
}
"""Term of an observation -> its signs in the mirror; terms of joints follow the joints."""


class Mirror:
    """Reflection in the sagittal plane, of joint vectors and of one layout of observations."""

    def __init__(self, spec: RobotSpec, terms: tuple[Term, ...], device: torch.device) -> None:
        """Find the robot's symmetry.

        Raises:
            RobotError: Its sides are not equal.
        """
        symmetry = sagittal_symmetry(spec)
        order, signs = list(symmetry.joints), list(symmetry.signs)
        columns: list[int] = []
        factors: list[float] = []
        for term in terms:
            start = len(columns)
            joints = term.name not in SIGNS
            columns += [start + i for i in (order if joints else range(term.size))]
            factors += signs if joints else SIGNS[term.name]
        self._joints = torch.tensor(order, device=device)
        self._signs = torch.tensor(signs, device=device)
        self._columns = torch.tensor(columns, device=device)
        self._factors = torch.tensor(factors, device=device)

    def joints(self, values: torch.Tensor) -> torch.Tensor:
        """(N, J) positions, velocities or actions of the joints."""
        return values[:, self._joints] * self._signs

    def observation(self, values: torch.Tensor) -> torch.Tensor:
        """(N, width of the layout)."""
        return values[:, self._columns] * self._factors
