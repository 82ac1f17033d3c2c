"""A stretch of frames solved by Ipopt: constraints that matter only, taken in as they are met."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import casadi as ca
import numpy as np

from lacoloco.pipelines.retargeting.solve.frame_functions import FrameFunctions
from lacoloco.pipelines.retargeting.solve.pose_problem import JOINTS
from lacoloco.pipelines.retargeting.solve.solver import COLD
from lacoloco.pipelines.retargeting.solve.stretch_program import stretch_program
from lacoloco.pipelines.retargeting.targets.stretch import Stretch, turn_pull

OPTIONS: Mapping[str, Any] = {
    **COLD,
    "error_on_fail": False,
    "ipopt.tol": 1e-4,
    "ipopt.max_iter": 40,
    # Animals that sit or lie leave the robot poses that hardly differ in cost, along which Newton's
    # method creeps; so one iteration that changes the cost little (CHANGE) is the last.
    "ipopt.acceptable_iter": 1,
    "ipopt.acceptable_tol": 1.0,
    "ipopt.acceptable_constr_viol_tol": 3e-4,
    "ipopt.acceptable_compl_inf_tol": 1e-2,
    "ipopt.mu_init": 1e-5,
    # From 1, Ipopt's own, multipliers take many iterations to come down.
    "ipopt.bound_mult_init_val": 0.1,
    "ipopt.constr_mult_init_max": 0.0,
    # A little compliance of the constraints makes the matrix quasidefinite: it is factorised in any
    # order without pivoting, which halves the time of MUMPS (ordering 0 is AMD).
    "ipopt.perturb_always_cd": "yes",
    "ipopt.jacobian_regularization_value": 1e-5,
    "ipopt.mumps_pivtol": 0.0,
    "ipopt.mumps_pivtolmax": 0.0,
    "ipopt.mumps_pivot_order": 0,
    "ipopt.mumps_scaling": 0,
    "ipopt.mumps_permuting_scaling": 0,
    "ipopt.mumps_mem_percent": 50,
    "ipopt.min_refinement_steps": 0,
}
ROUGH: Mapping[str, Any] = {**OPTIONS, "ipopt.tol": 1e-2, "ipopt.mu_init": 1e-3}
"""For a solution that is only the next one's guess."""
CHANGE = 2e-3
"""Relative change of the cost at which the iterations end."""
BROKEN = 5e-3
"""m or rad by which constraints may be violated when the iterations run out."""
ROUNDS = 4
"""How often constraints may be taken in."""
NEAR, FAST = 0.1, 0.4
"""m from its bound, and share of its limit from the greatest step, within which a row counts."""
VIOLATED, TOO_FAST = 3e-4, 0.01
"""m, and share of the greatest step, by which a row that was left out may be violated."""
ENDS = 4
"""Steps at either end that always count: nothing beyond them makes them smooth."""
SPREAD = 2
"""Frames beside one whose row is taken in, whose rows are taken in, too."""


def solve_stretch(
    functions: FrameFunctions, stretch: Stretch, smoothness: np.ndarray, *, rough: bool = False
) -> np.ndarray | None:
    """Solve the program of a stretch.

    Args:
        functions: Of one frame.
        stretch: The frames; those whose variables have equal bounds do not move.
        smoothness: (n,) weights of the squared third differences.
        rough: Be content with a guess.

    Returns:
        Variables (N, n), or None when Ipopt does not converge, or when rows that were left out are
        still violated after ROUNDS.
    """
    lower, upper = _bounds(stretch)
    counts = (np.isfinite(lower) | np.isfinite(upper)) & ~_still(stretch)
    rows, margins = _rows(functions, stretch, stretch.guess), _per_row(stretch, NEAR, FAST)
    used = (rows < lower + margins) | (rows > upper - margins) | _steps_at_ends(stretch)
    used &= counts
    tolerances = _per_row(stretch, VIOLATED, TOO_FAST)
    for _ in range(1 if rough else ROUNDS):
        solution = _solve_rows(functions, stretch, smoothness, used, ROUGH if rough else OPTIONS)
        if solution is None:
            return None
        rows = _rows(functions, stretch, solution)
        violated = (rows < lower - tolerances) | (rows > upper + tolerances)
        if not (violated & counts & ~used).any():
            break
        used |= _with_neighbours(violated, stretch) & counts
        stretch = replace(stretch, guess=solution)
    else:
        return solution if rough else None
    return solution


def _solve_rows(
    functions: FrameFunctions,
    stretch: Stretch,
    smoothness: np.ndarray,
    used: np.ndarray,
    options: Mapping[str, Any],
) -> np.ndarray | None:
    """Solve with some of the constraints only."""
    cost = float(functions.cost(stretch.guess, stretch.parameters).sum())
    # Ipopt's change is relative to the greater of the cost and 1.
    change = {"ipopt.acceptable_obj_change_tol": CHANGE * min(cost, 1.0)}
    rows, frames = np.flatnonzero(used), len(stretch.guess)
    solver = stretch_program(
        functions.derivatives, frames, smoothness, rows.tolist(), {**options, **change}
    )
    pull = turn_pull(stretch.parameters[:, :4], smoothness)
    lower, upper = _bounds(stretch)
    solution = solver(
        x0=stretch.guess.ravel(),
        p=np.concatenate([stretch.parameters.ravel(), pull.ravel()]),
        lbx=stretch.variable_bounds[0].ravel(),
        ubx=stretch.variable_bounds[1].ravel(),
        lbg=lower[rows],
        ubg=upper[rows],
    )
    return np.array(solution["x"]).reshape(stretch.guess.shape) if _good(solver) else None


def _good(solver: ca.Function) -> bool:
    """Whether the last solution converged, or ran out of iterations with constraints nearly met."""
    stats = solver.stats()
    if stats["success"]:
        return True
    ran_out = stats["return_status"] == "Maximum_Iterations_Exceeded"
    return ran_out and stats["iterations"]["inf_pr"][-1] < BROKEN


def _rows(functions: FrameFunctions, stretch: Stretch, x: np.ndarray) -> np.ndarray:
    """Values of all rows at variables (N, n)."""
    (points,) = functions.coordinates(x, stretch.parameters)
    values, steps = points[:, functions.value_rows], np.diff(x[:, JOINTS], axis=0)
    return np.concatenate([values.ravel(), steps.ravel()])


def _bounds(stretch: Stretch) -> tuple[np.ndarray, np.ndarray]:
    """Of all rows."""
    steps = np.tile(stretch.step_limit, len(stretch.guess) - 1)
    lower, upper = stretch.value_bounds
    return np.concatenate([lower.ravel(), -steps]), np.concatenate([upper.ravel(), steps])


def _per_row(stretch: Stretch, values: float, steps: float) -> np.ndarray:
    """One number for all values, one share of the limits for all steps."""
    count = stretch.value_bounds[0].size
    limits = np.tile(steps * stretch.step_limit, len(stretch.guess) - 1)
    return np.concatenate([np.full(count, values), limits])


def _still(stretch: Stretch) -> np.ndarray:
    """Rows of frames that do not move."""
    lower, upper = stretch.variable_bounds
    held = (lower == upper).all(axis=1)
    values = np.repeat(held, stretch.value_bounds[0].shape[1])
    return np.concatenate([values, np.repeat(held[:-1] & held[1:], len(stretch.step_limit))])


def _steps_at_ends(stretch: Stretch) -> np.ndarray:
    steps = np.zeros((len(stretch.guess) - 1, len(stretch.step_limit)), dtype=bool)
    steps[:ENDS] = steps[-ENDS:] = True
    return np.concatenate([np.zeros(stretch.value_bounds[0].size, dtype=bool), steps.ravel()])


def _with_neighbours(violated: np.ndarray, stretch: Stretch) -> np.ndarray:
    """Rows and the same rows of the frames beside them."""
    parts = np.split(violated, [stretch.value_bounds[0].size])
    widths, grown = (stretch.value_bounds[0].shape[1], len(stretch.step_limit)), []
    for part, width in zip(parts, widths, strict=True):
        narrow = part.reshape(-1, width)
        wide = narrow.copy()
        for shift in range(1, SPREAD + 1):
            wide[shift:] |= narrow[:-shift]
            wide[:-shift] |= narrow[shift:]
        grown.append(wide.ravel())
    return np.concatenate(grown)
