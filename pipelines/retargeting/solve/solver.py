"""Ipopt through CasADi for programs that are solved again and again with other parameters."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

COLD: Mapping[str, Any] = {
    "print_time": False,
    "record_time": False,
    "show_eval_warnings": False,
    "error_on_fail": True,  # failure is an exception, so that success costs no look at `stats`
    "ipopt.print_level": 0,
    "ipopt.sb": "yes",
    "ipopt.hessian_approximation": "exact",
}
"""Ipopt as it comes: for poor guesses."""

WARM: Mapping[str, Any] = {
    **COLD,
    # A guess that is nearly right stays where it is, also when it lies on a bound.
    "ipopt.warm_start_init_point": "yes",
    "ipopt.warm_start_bound_push": 1e-9,
    "ipopt.warm_start_bound_frac": 1e-9,
    "ipopt.warm_start_slack_bound_push": 1e-9,
    "ipopt.warm_start_slack_bound_frac": 1e-9,
    "ipopt.warm_start_mult_bound_push": 1e-9,
    "ipopt.mu_init": 1e-8,
    "ipopt.mu_strategy": "monotone",
    "ipopt.nlp_scaling_method": "none",
    "ipopt.tol": 1e-6,
    "ipopt.max_iter": 50,  # what needs more is better off with another start
}
"""For a guess, with multipliers, that is close to the solution."""


@dataclass(frozen=True)
class Program:
    """A nonlinear program: minimise `cost` with variables and constraints between bounds."""

    variables: ca.SX
    parameters: ca.SX
    cost: ca.SX
    constraints: ca.SX
    variable_bounds: tuple[np.ndarray, np.ndarray]
    constraint_bounds: tuple[np.ndarray, np.ndarray]


@dataclass(frozen=True)
class Solution:
    """A local minimum, and the multipliers that the next solve can start from."""

    variables: np.ndarray
    cost: float
    variable_multipliers: np.ndarray
    constraint_multipliers: np.ndarray


class Solver:
    """A program with its derivatives, built once, and the memory that its solves share."""

    def __init__(self, program: Program, options: Mapping[str, Any]) -> None:
        """Build it; this takes longer than many solves."""
        nlp = {
            "x": program.variables,
            "p": program.parameters,
            "f": program.cost,
            "g": program.constraints,
        }
        solver = ca.nlpsol("solver", "ipopt", nlp, dict(options))
        # Calls without copies: half of the overhead. CasADi's stubs describe other arguments.
        buffer: Any = solver.buffer()
        self._buffer, self._run = buffer
        self._inputs = [np.zeros(max(solver.numel_in(i), 1)) for i in range(solver.n_in())]
        self._outputs = [np.zeros(max(solver.numel_out(i), 1)) for i in range(solver.n_out())]
        for index, array in enumerate(self._inputs):
            self._buffer.set_arg(index, array.data)
        for index, array in enumerate(self._outputs):
            self._buffer.set_res(index, array.data)
        bounds = (*program.variable_bounds, *program.constraint_bounds)
        for array, bound in zip(self._inputs[2:6], bounds, strict=True):
            array[:] = bound

    def solve(
        self, guess: np.ndarray, parameters: np.ndarray, near: Solution | None = None
    ) -> Solution | None:
        """Solve once.

        Args:
            guess: Start of the variables.
            parameters: Values of the parameters.
            near: Solution of a similar program, for its multipliers.

        Returns:
            The solution, or None when Ipopt does not converge.
        """
        self._inputs[0][:] = guess
        self._inputs[1][:] = parameters
        self._inputs[6][:] = 0.0 if near is None else near.variable_multipliers
        self._inputs[7][:] = 0.0 if near is None else near.constraint_multipliers
        try:
            self._run()
        except RuntimeError:
            return None
        variables, cost, _, variable_multipliers, constraint_multipliers, *_ = self._outputs
        return Solution(
            variables.copy(),
            float(cost[0]),
            variable_multipliers.copy(),
            constraint_multipliers.copy(),
        )
