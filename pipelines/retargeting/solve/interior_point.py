"""A primal-dual interior-point method for the program of a stretch.

A general solver orders and factorises a sparse matrix anew; here its structure is known. Planted
feet take up most of a frame's freedom, so the steps are found in what is left of it.
"""

from __future__ import annotations

import numpy as np

from lacoloco.pipelines.retargeting.solve.barrier import Barrier, longest_step
from lacoloco.pipelines.retargeting.solve.clip_model import ClipModel, Point
from lacoloco.pipelines.retargeting.solve.frame_functions import FrameFunctions
from lacoloco.pipelines.retargeting.targets.stretch import Stretch

MU, ROUGH_MU = 1e-5, 1e-3
"""Product of slack and multiplier at the solution, m^2; of one that is only the next one's
guess.
"""
ITERATIONS = 40
CHANGE = 4e-3
"""Relative change of the cost, per whole step, at which the iterations end. Animals that sit or lie
leave the robot poses that hardly differ in cost; Newton's method creeps along such a valley."""
PATIENCE = 5
"""Iterations one after another that change the cost less, after which BROKEN will do."""
FEASIBLE, BROKEN = 3e-4, 5e-3
"""m or rad by which constraints may be missed in the end; when patience or iterations run out."""
HALVINGS = 8
"""How often a step is halved that makes both cost and constraints worse."""
STUCK = 1e-4
"""Share of a step that is not worth taking: the constraints contradict each other."""


def solve_stretch(
    functions: FrameFunctions, stretch: Stretch, smoothness: np.ndarray, *, rough: bool = False
) -> np.ndarray | None:
    """Solve the program of a stretch.

    Args:
        functions: Of one frame.
        stretch: The frames.
        smoothness: (n,) weights of the squared third differences.
        rough: Be content with a guess.

    Returns:
        Variables (N, n), or None when it does not converge.
    """
    model = ClipModel(functions, stretch, smoothness)
    point = model.start()
    barrier = Barrier(model.lower, model.upper, ROUGH_MU if rough else MU, point.rows)
    multipliers, idle = np.zeros_like(point.gap), 0
    for _ in range(ITERATIONS):
        try:
            stiffness, force = barrier.condensed(point.rows)
            step, wanted = model.step(point, stiffness, force, barrier.outward(), multipliers)
        except np.linalg.LinAlgError:
            return None
        reached, share = _taken(model, barrier, point, step)
        if reached is None:
            return None
        multipliers = multipliers + share * (wanted - multipliers)
        slow = abs(reached.cost - point.cost) <= share * CHANGE * abs(reached.cost)
        point = reached
        idle = idle + 1 if slow else 0
        if slow and _worst(barrier, point) < (BROKEN if idle >= PATIENCE else FEASIBLE):
            break
    return point.x if _worst(barrier, point) < BROKEN else None


def _taken(
    model: ClipModel, barrier: Barrier, point: Point, step: np.ndarray
) -> tuple[Point | None, float]:
    """Go along a step while slacks and multipliers stay positive and something improves.

    Returns:
        The new point, None if there is none, and the share of the step.
    """
    slacks, multipliers = barrier.step(point.rows, model.change(point, step))
    share = longest_step(barrier.slacks, slacks)
    if share < STUCK:
        return None, share
    cost, missed = _merit(barrier, point, barrier.slacks)
    for _ in range(HALVINGS):
        reached = barrier.slacks + share * slacks
        trial = model.at(point.x + share * step)
        new_cost, new_missed = _merit(barrier, trial, reached)
        if new_cost <= cost or new_missed <= (1 - 1e-4 * share) * missed:
            barrier.slacks = reached
            along = longest_step(barrier.multipliers, multipliers)
            barrier.multipliers = barrier.multipliers + along * multipliers
            return trial, share
        share *= 0.5
    return None, share


def _merit(barrier: Barrier, point: Point, slacks: np.ndarray) -> tuple[float, float]:
    """Cost with its barrier, and by how much all constraints are missed."""
    missed = np.abs(barrier.distances(point.rows) - slacks).sum() + np.abs(point.gap).sum()
    return point.cost + barrier.value(slacks), float(missed)


def _worst(barrier: Barrier, point: Point) -> float:
    """Greatest amount by which a constraint is missed, m or rad."""
    gap = np.abs(barrier.distances(point.rows) - barrier.slacks).max(initial=0.0)
    return max(float(gap), float(np.abs(point.gap).max()))
