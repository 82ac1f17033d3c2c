"""The sparse program of a stretch of frames: tracking, smoothness, and constraints where they count.

    min_x  sum_t c_t(x_t) + sum_t |third difference of x|_w^2
    s.t.   feet that stand: where they are planted;  feet that swing, knees, hips: above their floor
           joints: within limits, also of speed

Rows of constraints that are far from active are left out at first; the solution is checked against
all of them, and solved again with those it breaks.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import casadi as ca
import numpy as np

from lacoloco.pipelines.retargeting.frame_functions import FrameFunctions
from lacoloco.pipelines.retargeting.pose_problem import JOINTS
from lacoloco.pipelines.retargeting.solver import COLD
from lacoloco.pipelines.retargeting.stretch import THIRD, Stretch, turn_pull

OPTIONS = {
    **COLD,
    "error_on_fail": False,
    "ipopt.tol": 1e-4,  # a tenth of a millimetre; costs are sums of squares of millimetres
    "ipopt.mu_init": 1e-5,
    "ipopt.min_refinement_steps": 0,
    # Animals that sit or lie leave the robot poses that hardly differ in cost; Newton's method then
    # creeps along the valley for ever. What changes the cost by less than CHANGE is as good.
    "ipopt.acceptable_iter": 1,
    "ipopt.acceptable_constr_viol_tol": 1e-3,
    "ipopt.acceptable_compl_inf_tol": 1.0,
    "ipopt.acceptable_tol": 1.0,
    "ipopt.max_iter": 40,
}
ROUGH = {**OPTIONS, "ipopt.tol": 1e-2, "ipopt.mu_init": 1e-3}
"""For a solution that is only the next one's guess."""
CHANGE = 4e-3
"""Relative change of the cost from one iteration to the next."""
BROKEN = 5e-3
"""m or rad by which constraints may be broken when the iterations run out; feet are mended later."""
ROUNDS = 4
"""How often rows are added before the rest of the violation is accepted and reported."""
TOLERANCE, FASTER = 3e-4, 0.01
"""m, or share of a speed limit, by which a row that was left out may be broken."""
ENDS = 4
"""Steps at either end of a stretch whose speed is always limited."""
NEAR, FAST = 0.06, 0.6
"""m to its floor, or share of its speed to its limit, from which a guess is no reason to leave out
a row."""


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
        Variables (N, n), or None when Ipopt does not converge.
    """
    lower, upper = _all_bounds(stretch)
    values = _all_values(functions, stretch.guess, stretch.parameters)
    margins, tolerances = _per_row(stretch, NEAR, FAST), _per_row(stretch, TOLERANCE, FASTER)
    used = (values < lower + margins) | (values > upper - margins) | _steps_at_ends(stretch)
    options = dict(ROUGH if rough else OPTIONS)
    for _ in range(1 if rough else ROUNDS):
        rows = np.flatnonzero(used)
        # Ipopt takes the change of a cost below 1, that of a short clip, as it is.
        cost = float(ca.sum2(functions.cost(stretch.guess.T, stretch.parameters.T)))
        options["ipopt.acceptable_obj_change_tol"] = CHANGE * min(cost, 1.0)
        solver = _build(functions, len(stretch.guess), smoothness, rows.tolist(), options)
        solution = _solve_rows(solver, stretch, smoothness, lower[rows], upper[rows])
        if solution is None:
            return None
        values = _all_values(functions, solution, stretch.parameters)
        broken = (values < lower - tolerances) | (values > upper + tolerances)
        if not (broken & ~used).any():
            break
        used |= _with_neighbours(broken, stretch)
        stretch = replace(stretch, guess=solution)
    return solution


def _solve_rows(
    solver: ca.Function,
    stretch: Stretch,
    smoothness: np.ndarray,
    lower: np.ndarray,
    upper: np.ndarray,
) -> np.ndarray | None:
    pull = turn_pull(stretch.parameters[:, :4], smoothness)
    solution = solver(
        x0=stretch.guess.ravel(),
        p=np.concatenate([stretch.parameters.ravel(), pull.ravel()]),
        lbx=stretch.variable_bounds[0].ravel(),
        ubx=stretch.variable_bounds[1].ravel(),
        lbg=lower,
        ubg=upper,
    )
    outcome = solver.stats()
    if not outcome["success"]:
        out_of_time = outcome["return_status"] == "Maximum_Iterations_Exceeded"
        if not out_of_time or outcome["iterations"]["inf_pr"][-1] > BROKEN:
            return None
    return np.array(solution["x"]).reshape(stretch.guess.shape)


def _build(
    functions: FrameFunctions,
    frames: int,
    smoothness: np.ndarray,
    rows: Sequence[int],
    options: Mapping[str, Any],
) -> ca.Function:
    """Ipopt for N frames, all derivatives assembled from those of one frame."""
    n, m, count = functions.variables, functions.parameters, functions.values_count
    x, p = ca.MX.sym("x", n * frames), ca.MX.sym("p", (m + n) * frames)
    at = [ca.reshape(x, n, frames), ca.reshape(p[: m * frames], m, frames)]
    pull = p[m * frames :]
    roughness = _roughness(frames, smoothness)
    rough = roughness @ x
    cost = ca.sum2(functions.cost.map(frames)(*at)) + ca.dot(0.5 * rough + pull, x)
    gradient = ca.vec(functions.gradient.map(frames)(*at)) + rough + pull

    steps = _joint_steps(frames, n)
    values = ca.vertcat(ca.vec(functions.values.map(frames)(*at)), steps @ x)[rows]
    blocks = ca.diagcat(*[functions.jacobian_sparsity] * frames)
    jacobian = ca.MX(blocks, ca.vec(functions.jacobian.map(frames)(*at)))
    jacobian = ca.vertcat(jacobian, ca.MX(steps))[rows, :]

    scale, multipliers = ca.MX.sym("scale"), ca.MX.sym("multipliers", len(rows))
    spread = ca.MX.zeros(count * frames + steps.shape[0])
    if rows:
        spread[rows] = multipliers
    by_frame = ca.reshape(spread[: count * frames], count, frames)
    curvature = functions.hessian.map(frames)(*at, ca.repmat(scale, 1, frames), by_frame)
    blocks = ca.diagcat(*[functions.hessian_sparsity] * frames)
    hessian = ca.MX(blocks, ca.vec(curvature)) + scale * ca.triu(roughness)

    derivatives = {
        "grad_f": ca.Function("nlp_grad_f", [x, p], [cost, gradient]),
        "jac_g": ca.Function("nlp_jac_g", [x, p], [values, jacobian]),
        "hess_lag": ca.Function("nlp_hess_l", [x, p, scale, multipliers], [hessian]),
    }
    program = {"x": x, "p": p, "f": cost, "g": values}
    return ca.nlpsol("clip", "ipopt", program, {**options, **derivatives})


def _roughness(frames: int, smoothness: np.ndarray) -> ca.DM:
    """Hessian of the smoothness of N frames."""
    differences = _sparse_rows(frames, THIRD)
    weighted = ca.kron(differences, ca.diag(ca.DM(np.sqrt(smoothness))))
    return 2 * weighted.T @ weighted


def _joint_steps(frames: int, n: int) -> ca.DM:
    """Matrix that gives, from all variables, how far each joint moves from frame to frame."""
    joints = ca.DM.eye(n)[JOINTS, :]
    return ca.kron(_sparse_rows(frames, (-1.0, 1.0)), joints)


def _sparse_rows(frames: int, stencil: Sequence[float]) -> ca.DM:
    rows = max(frames - len(stencil) + 1, 0)
    where = [(row, row + k, value) for k, value in enumerate(stencil) for row in range(rows)]
    if not where:
        return ca.DM(0, frames)
    row, column, value = zip(*where, strict=True)
    return ca.DM.triplet(list(row), list(column), ca.DM(value), rows, frames)


def _all_values(functions: FrameFunctions, x: np.ndarray, parameters: np.ndarray) -> np.ndarray:
    values = np.array(functions.values(x.T, parameters.T)).T
    return np.concatenate([values.ravel(), np.diff(x[:, JOINTS], axis=0).ravel()])


def _all_bounds(stretch: Stretch) -> tuple[np.ndarray, np.ndarray]:
    steps = np.tile(stretch.step_limit, len(stretch.guess) - 1)
    lower, upper = stretch.value_bounds
    return np.concatenate([lower.ravel(), -steps]), np.concatenate([upper.ravel(), steps])


def _per_row(stretch: Stretch, values: float, steps: float) -> np.ndarray:
    """One number for every constraint value, a share of the limit for every step of a joint."""
    frames, count = stretch.value_bounds[0].shape
    return np.concatenate(
        [np.full(frames * count, values), np.tile(steps * stretch.step_limit, frames - 1)]
    )


def _steps_at_ends(stretch: Stretch) -> np.ndarray:
    """Rows of the first and last steps of the joints, where nothing beyond holds the speed down."""
    frames, count = stretch.value_bounds[0].shape
    steps = np.zeros((frames - 1, len(stretch.step_limit)), dtype=bool)
    steps[:ENDS] = steps[-ENDS:] = True
    return np.concatenate([np.zeros(frames * count, dtype=bool), steps.ravel()])


def _with_neighbours(broken: np.ndarray, stretch: Stretch) -> np.ndarray:
    """Broken rows, and the same rows two frames before and after."""
    frames, count = stretch.value_bounds[0].shape
    parts = np.split(broken, [frames * count])
    grown = []
    for part, width in zip(parts, (count, len(stretch.step_limit)), strict=True):
        mask = part.reshape(-1, width)
        wide = mask.copy()
        for shift in (1, 2):
            wide[shift:] |= mask[:-shift]
            wide[:-shift] |= mask[shift:]
        grown.append(wide.ravel())
    return np.concatenate(grown)
