"""The program of a stretch for Ipopt, its derivatives put together from those of one frame.

    min_x  sum_t c_t(x_t) + sum_t |third difference of x|_w^2
    s.t.   feet that stand: where they are planted;  feet that swing, knees, hips: above their floor
           joints: within limits, also of speed

CasADi would derive it by itself, but coloured Jacobians of thousands of frames cost more than the
solution. Rows of constraints are all constraint values, then all steps of joints from frame to
frame.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import casadi as ca
import numpy as np

from lacoloco.pipelines.retargeting.solve.frame_derivatives import FrameDerivatives
from lacoloco.pipelines.retargeting.solve.pose_problem import JOINTS
from lacoloco.pipelines.retargeting.targets.stretch import THIRD


def stretch_program(
    frame: FrameDerivatives,
    frames: int,
    smoothness: np.ndarray,
    rows: Sequence[int],
    options: Mapping[str, Any],
) -> ca.Function:
    """Build the solver.

    Args:
        frame: Functions of one frame.
        frames: N.
        smoothness: (n,) weights of the squared third differences.
        rows: Which rows of the constraints there are.
        options: Of Ipopt.

    Returns:
        Solver of the variables, frame after frame; its parameters are those of the frames, then the
        linear cost (N n) of the turns.
    """
    x = ca.MX.sym("x", frame.variables * frames)
    p = ca.MX.sym("p", (frame.parameters + frame.variables) * frames)
    split = frame.parameters * frames
    at = (
        ca.reshape(x, frame.variables, frames),
        ca.reshape(p[:split], frame.parameters, frames),
    )
    pull, roughness = p[split:], _roughness(frames, smoothness)
    rough, steps = roughness @ x, _joint_steps(frames, frame.variables)
    smooth = ca.dot(0.5 * rough + pull, x)
    cost = ca.sum2(frame.cost.map(frames)(*at)) + smooth
    values = ca.vertcat(ca.vec(frame.value.map(frames)(*at)), steps @ x)[rows]

    costs, gradients = frame.cost_gradient.map(frames)(*at)
    all_values, nonzeros = frame.value_jacobian.map(frames)(*at)
    jacobian = ca.vertcat(_blocks(frame.jacobian_pattern, nonzeros), ca.MX(steps))
    weight, multipliers = ca.MX.sym("weight"), ca.MX.sym("multipliers", len(rows))
    spread = ca.MX.zeros(frame.values * frames + steps.shape[0])
    if rows:
        spread[rows] = multipliers
    by_frame = ca.reshape(spread[: frame.values * frames], frame.values, frames)
    curvature = frame.hessian.map(frames)(*at, ca.repmat(weight, 1, frames), by_frame)
    hessian = _blocks(frame.hessian_pattern, curvature) + weight * ca.triu(roughness)
    derivatives = {
        "grad_f": (
            [x, p],
            [ca.sum2(costs) + smooth, ca.vec(gradients) + rough + pull],
        ),
        "jac_g": (
            [x, p],
            [ca.vertcat(ca.vec(all_values), steps @ x)[rows], jacobian[rows, :]],
        ),
        "hess_lag": ([x, p, weight, multipliers], [hessian]),
    }
    functions = {name: ca.Function(name, *parts) for name, parts in derivatives.items()}
    program = {"x": x, "p": p, "f": cost, "g": values}
    return ca.nlpsol("stretch", "ipopt", program, {**options, **functions})


def _blocks(pattern: ca.Sparsity, nonzeros: ca.MX) -> ca.MX:
    """Block-diagonal matrix of equal patterns, from the nonzeros of each block, a column each."""
    return ca.MX(ca.diagcat(*[pattern] * nonzeros.shape[1]), ca.vec(nonzeros))


def _roughness(frames: int, smoothness: np.ndarray) -> ca.DM:
    """Hessian of the weighted squares of third differences."""
    weighted = ca.kron(_differences(frames, THIRD), ca.diag(ca.DM(np.sqrt(smoothness))))
    return 2 * weighted.T @ weighted


def _joint_steps(frames: int, variables: int) -> ca.DM:
    """Matrix that takes variables to steps of the joints from frame to frame."""
    return ca.kron(_differences(frames, (-1.0, 1.0)), ca.DM.eye(variables)[JOINTS, :])


def _differences(frames: int, stencil: Sequence[float]) -> ca.DM:
    """Matrix of all differences of frames; no rows when there are too few frames."""
    rows = np.arange(max(frames - len(stencil) + 1, 0))
    matrix = ca.DM(len(rows), frames)
    for shift, value in enumerate(stencil):
        columns = (rows + shift).tolist()
        matrix += ca.DM.triplet(
            rows.tolist(), columns, ca.DM([value] * len(rows)), len(rows), frames
        )
    return matrix
