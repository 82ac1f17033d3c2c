"""One frame's cost and constraint values with their derivatives, as CasADi functions to be mapped
over frames.
"""

from __future__ import annotations

import casadi as ca


class FrameDerivatives:
    """Functions of variables (n,) and parameters (m,).

    Attributes:
        variables: n.
        parameters: m.
        values: V.
        cost: The cost, m^2.
        cost_gradient: The cost and its gradient (n,).
        value: Constraint values (V,).
        value_jacobian: The same, and the nonzeros of their Jacobian.
        hessian: Nonzeros of the upper triangle of the Lagrangian's Hessian, from the weight of the
            cost and multipliers (V,) in addition.
        jacobian_pattern: (V, n) of the Jacobian.
        hessian_pattern: (n, n) of the upper triangle.
    """

    def __init__(self, x: ca.SX, parameters: ca.SX, residuals: ca.SX, values: ca.SX) -> None:
        """Derive them.

        Args:
            x: Variables.
            parameters: What does not vary.
            residuals: The cost is the sum of their squares.
            values: Constraint values.
        """
        at, weight = [x, parameters], ca.SX.sym("weight")
        multipliers = ca.SX.sym("multipliers", values.numel())
        cost, jacobian = ca.sumsqr(residuals), ca.jacobian(values, x)
        hessian = ca.triu(_hessian(x, residuals, values, weight, multipliers))
        self.variables, self.parameters = x.numel(), parameters.numel()
        self.values = values.numel()
        self.cost = _function("cost", at, [cost])
        self.cost_gradient = _function("cost_gradient", at, [cost, ca.gradient(cost, x)])
        self.value = _function("value", at, [values])
        self.value_jacobian = _function("value_jacobian", at, [values, _nonzeros(jacobian)])
        self.hessian = _function("hessian", [*at, weight, multipliers], [_nonzeros(hessian)])
        self.jacobian_pattern, self.hessian_pattern = jacobian.sparsity(), hessian.sparsity()


def _hessian(x: ca.SX, residuals: ca.SX, values: ca.SX, weight: ca.SX, multipliers: ca.SX) -> ca.SX:
    """Hessian of the Lagrangian: Gauss and Newton's, and the curvature of residuals and values.

    It is the same as that of the cost's own, with two thirds of the operations.
    """
    forces = ca.SX.sym("forces", residuals.numel())
    curvature = ca.hessian(ca.dot(forces, residuals) + ca.dot(multipliers, values), x)[0]
    gradients = ca.jacobian(residuals, x)
    bent = ca.substitute(curvature, forces, 2 * weight * residuals)
    return 2 * weight * (gradients.T @ gradients) + bent


def _nonzeros(matrix: ca.SX) -> ca.SX:
    return ca.SX(matrix.nz[:])


def _function(name: str, inputs: list[ca.SX], outputs: list[ca.SX]) -> ca.Function:
    return ca.Function(name, inputs, outputs, {"cse": True})
