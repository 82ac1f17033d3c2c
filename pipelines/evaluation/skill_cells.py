"""Cells of what a robot does: forward, lateral and yaw velocity of its base, and height of its end
effector.

Shares that walk, reach and stand do not tell whether the latents still turn, or walk backwards. So
moments are sorted into cells of these four numbers, and the clips' cells are compared with those
that some latent reaches. How wide a cell is follows from the robot: what counts as walking and as
reaching in its file, and half of the yaw rate that its walking task asks for.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch

from lacoloco.pipelines.sim.commands import VelocityCommand
from lacoloco.pipelines.sim.tasks import load_task
from lacoloco.robots.spec import RobotSpec

AXES = ("forward", "lateral", "yaw", "lift")
UNITS = ("m/s", "m/s", "rad/s", "m")
FORWARD, LATERAL, YAW, LIFT = range(4)
WAYS = (
    ("forward", "backward"),
    ("to the left", "to the right"),
    ("turning left", "turning right"),
)
"""What a velocity above 0 and one below it are called."""
WALK = "walk"


@dataclass(frozen=True)
class SkillCells:
    """A grid over (n, 4) motions: mean forward and lateral velocity [m/s], yaw rate [rad/s], and
    lift of the end effector above its height in standing [m].

    The middle cell of a velocity reaches from its threshold in one direction to that in the other,
    and its neighbours are as wide. The first cell of lift ends at its threshold, all others are as
    high as that.

    Attributes:
        walk_speed: Threshold of both planar velocities [m/s].
        turn_speed: Threshold of the yaw rate [rad/s].
        reach_height: Threshold of the lift [m].
    """

    walk_speed: float
    turn_speed: float
    reach_height: float

    @classmethod
    def of(cls, spec: RobotSpec) -> SkillCells:
        """The robot's."""
        skills = spec.skills
        return cls(skills.walk_speed, turn_speed(spec), skills.reach_height)

    @property
    def widths(self) -> tuple[float, float, float, float]:
        """Width of a cell along each axis."""
        planar = 2.0 * self.walk_speed
        return planar, planar, 2.0 * self.turn_speed, self.reach_height

    def index(self, motion: torch.Tensor) -> torch.Tensor:
        """(n, 4) whole numbers of the cells of motions (n, 4); 0 is the middle, and standing."""
        scaled = motion / torch.tensor(self.widths, device=motion.device)
        number = scaled.round()
        number[:, LIFT] = scaled[:, LIFT].floor().clamp_min(0.0)
        return number.long()

    def edges(self, axis: int, first: int, last: int) -> list[float]:
        """Edges of the cells from number ``first`` to ``last`` along one axis."""
        start = 0.0 if axis == LIFT else -0.5
        return [self.widths[axis] * (number + start) for number in range(first, last + 2)]

    def describe(self, cell: tuple[int, ...]) -> str:
        """What moments of a cell show, for a person; a speed is that of the cell's middle."""
        parts = []
        for axis, (positive, negative) in enumerate(WAYS):
            if cell[axis]:
                speed = abs(cell[axis]) * self.widths[axis]
                way = positive if cell[axis] > 0 else negative
                parts.append(f"{way} {speed:.2g} {UNITS[axis]}")
        if cell[LIFT]:
            parts.append(f"end effector up {cell[LIFT] * self.reach_height:.2g} m or more")
        return ", ".join(parts) or "standing"


def turn_speed(spec: RobotSpec) -> float:
    """Yaw rate from which a robot counts as turning [rad/s]: half of the largest that its walking
    task asks for.

    Where no task asks for any, that at which a point as far from the base as the base is high moves
    as fast as what counts as walking.
    """
    command = load_task(spec, WALK).command if WALK in spec.tasks else None
    fastest = max(map(abs, command.yaw_rate)) if isinstance(command, VelocityCommand) else 0.0
    return 0.5 * fastest or spec.skills.walk_speed / spec.default_height()


@dataclass(frozen=True)
class CellCoverage:
    """What held latents show of what clips show.

    Attributes:
        cells: The grid.
        clips: (M, 4) motions of moments of the clips, drawn as often as they are used.
        latents: (N, 4) motions under held latents, without those that fell.
        held: Number of latents held.
    """

    cells: SkillCells
    clips: torch.Tensor
    latents: torch.Tensor
    held: int

    def metrics(self) -> dict[str, float]:
        """``coverage_cells``: share of the clips' moments whose cell at least one latent reaches.

        ``clips_cells``: what as many moments of the clips would be expected to reach instead of the
        latents; rare cells are missed by chance. ``coverage_turn_left``, ``coverage_turn_right``:
        shares of the held latents that turn, faster than the threshold; ``clips_turn_left``,
        ``clips_turn_right``: of the clips' moments.
        """
        used = self._used()[1]
        found = {
            "coverage_cells": float(self.reached().float().mean()),
            "clips_cells": float((used * (1.0 - (1.0 - used).pow(self.held))).sum()),
        }
        for name, motion, count in (
            ("coverage", self.latents, self.held),
            ("clips", self.clips, len(self.clips)),
        ):
            number = self.cells.index(motion)[:, YAW]
            found[f"{name}_turn_left"] = float((number > 0).sum()) / count
            found[f"{name}_turn_right"] = float((number < 0).sum()) / count
        return found

    def reached(self) -> torch.Tensor:
        """(M,) bool, moments of the clips whose cell at least one latent reaches."""
        cells = self.cells.index(torch.cat((self.clips, self.latents)))
        numbers = torch.unique(cells, dim=0, return_inverse=True)[1]
        return torch.isin(numbers[: len(self.clips)], numbers[len(self.clips) :])

    def lost(self) -> list[tuple[str, float]]:
        """Cells of the clips that no latent reaches, in words, with their shares of the clips'
        moments; the largest first.
        """
        cells, shares = self._used(~self.reached())
        rows = zip(cells.tolist(), shares.tolist(), strict=True)
        named = [(self.cells.describe(tuple(cell)), share) for cell, share in rows]
        return sorted(named, key=lambda row: -row[1])

    def _used(self, which: torch.Tensor | None = None) -> tuple[torch.Tensor, torch.Tensor]:
        """(k, 4) the cells of the clips' moments (of those of ``which`` (M,) bool), and (k,) their
        shares of all moments.
        """
        cells = self.cells.index(self.clips if which is None else self.clips[which])
        kinds, counts = torch.unique(cells, dim=0, return_counts=True)
        return kinds, counts.double() / len(self.clips)
