"""What one frame of a clip adds to the problem of the whole clip, with first and second derivatives.

CasADi would derive the problem of a whole clip by itself, but coloured Jacobians of thousands of
frames cost more than the solution. One frame is derived once, symbolically, and evaluated for all.
"""

from __future__ import annotations

import casadi as ca
import numpy as np

from lacoloco.pipelines import kinematics
from lacoloco.pipelines.retargeting.batched import BatchedFunction
from lacoloco.pipelines.retargeting.body_map import BodyMap
from lacoloco.pipelines.retargeting.pose_problem import JOINTS, POSITION, TURN
from lacoloco.robots.spec import RobotSpec


class FrameFunctions:
    """CasADi functions of one frame.

    Variables: position, turn on top of a reference orientation (a rotation vector to second order),
    joints. Parameters: reference quaternion, targets of the keypoints. Constraint values: x, y, z
    of each foot, then the heights of knees and hips.
    """

    def __init__(self, spec: RobotSpec, mapping: BodyMap, posture_weight: float) -> None:
        """Derive them."""
        self.variables = 6 + spec.num_joints
        x, reference = ca.SX.sym("x", self.variables), ca.SX.sym("reference", 4)
        targets = ca.SX.sym("targets", 3, len(spec.keypoints))
        parameters = ca.vertcat(reference, ca.vec(targets))
        model = spec.pinocchio_model()
        quat = kinematics.multiply(reference, kinematics.small_rotation(x[TURN] / 4))
        base = kinematics.SymbolicPose(kinematics.rotation_of(quat), x[POSITION])
        poses = kinematics.body_poses(model, base, x[JOINTS])
        points = [kinematics.body_position(model, poses, body) for body in spec.keypoints.values()]
        cost = ca.sumsqr(ca.horzcat(*points) - targets)
        cost += posture_weight * ca.sumsqr(x[JOINTS] - ca.DM(spec.retarget_neutral))
        feet = [points[column] for column in mapping.foot_columns]
        knees = [kinematics.body_position(model, poses, body)[2] for body in spec.knee_frames]
        hips = [points[column][2] for column in mapping.hip_columns]
        values = ca.vertcat(*feet, *knees, *hips)
        self.feet = slice(0, 3 * len(feet))
        self.heights = slice(3 * len(feet), values.numel())
        self.knees, self.hips = len(knees), len(hips)
        self._derive(x, parameters, cost, values)
        self.neutral, self.posture_weight = np.array(spec.retarget_neutral), posture_weight
        knee_rows = 3 * len(points) + np.arange(len(knees))
        foot_rows = 3 * np.repeat(mapping.foot_columns, 3) + np.tile(np.arange(3), len(feet))
        hip_rows = 3 * np.array(mapping.hip_columns) + 2
        self.value_rows = np.concatenate([foot_rows, knee_rows, hip_rows])
        self._derive_coordinates(x, parameters, ca.vertcat(*points, *knees))
        at = (x, reference, ca.vertcat(*feet), spec)
        self.leg_step = _leg_step(*at, posture=0.03, damping=1e-5)
        self.foot_step = _leg_step(*at, posture=0.0, damping=1e-7)

    def _derive(self, x: ca.SX, parameters: ca.SX, cost: ca.SX, values: ca.SX) -> None:
        self.parameters, self.values_count = parameters.numel(), values.numel()
        scale, multipliers = ca.SX.sym("scale"), ca.SX.sym("multipliers", values.numel())
        jacobian = ca.jacobian(values, x)
        lagrangian = scale * cost + ca.dot(multipliers, values)
        hessian = ca.triu(ca.hessian(lagrangian, x)[0])
        at = [x, parameters]
        self.cost = ca.Function("cost", at, [cost])
        self.gradient = ca.Function("gradient", at, [ca.gradient(cost, x)])
        self.values = ca.Function("values", at, [values])
        self.jacobian = ca.Function("jacobian", at, [ca.vertcat(*jacobian.nonzeros())])
        self.hessian = ca.Function(
            "hessian", [*at, scale, multipliers], [ca.vertcat(*hessian.nonzeros())]
        )
        self.jacobian_sparsity, self.hessian_sparsity = jacobian.sparsity(), hessian.sparsity()

    def _derive_coordinates(self, x: ca.SX, parameters: ca.SX, coordinates: ca.SX) -> None:
        at, forces = [x, parameters], ca.SX.sym("forces", coordinates.numel())
        jacobian = ca.densify(ca.jacobian(coordinates, x))
        curvature = ca.densify(ca.hessian(ca.dot(forces, coordinates), x)[0])
        self.geometry = BatchedFunction(ca.Function("geometry", at, [coordinates, jacobian]))
        self.curvature = BatchedFunction(ca.Function("curvature", [*at, forces], [curvature]))


def _leg_step(
    x: ca.SX, reference: ca.SX, feet: ca.SX, spec: RobotSpec, *, posture: float, damping: float
) -> ca.Function:
    """Gauss-Newton step (J,) of the joints towards feet (3 F,) and neutral pose, the base held."""
    targets, joints = ca.SX.sym("feet", feet.numel()), x[JOINTS]
    residual = feet - targets
    if posture:
        residual = ca.vertcat(residual, posture * (joints - ca.DM(spec.retarget_neutral)))
    jacobian = ca.jacobian(residual, joints)
    normal = jacobian.T @ jacobian + damping * ca.SX.eye(joints.numel())
    step = -ca.solve(normal, jacobian.T @ residual)
    return ca.Function("leg_step", [x, reference, targets], [step])
