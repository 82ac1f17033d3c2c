"""What one frame of a clip adds to the problem of the whole clip, derived once for all frames."""

from __future__ import annotations

import casadi as ca
import numpy as np

from lacoloco.pipelines.retargeting import forward_kinematics as kinematics
from lacoloco.pipelines.retargeting.mocap.body_map import BodyMap
from lacoloco.pipelines.retargeting.solve.batched import BatchedFunction
from lacoloco.pipelines.retargeting.solve.frame_derivatives import FrameDerivatives
from lacoloco.pipelines.retargeting.solve.pose_problem import JOINTS, POSITION, TURN
from lacoloco.robots.spec import RobotSpec


class FrameFunctions:
    """Functions of frames.

    Variables: position, turn on top of a reference orientation (a rotation vector to second order),
    joints. Parameters: reference quaternion, targets of the keypoints. Coordinates: x, y, z of each
    keypoint, then the heights of the knees. Constraint values, which are coordinates, too: x, y, z
    of each foot, then the heights of knees and hips.

    Attributes:
        coordinates: Coordinates of frames, from variables and parameters.
        derivatives: The frame's cost and constraint values, with first and second derivatives.
        leg_step: Step of the joints towards feet and the neutral pose, from variables, references
            and feet, the base held.
        foot_step: The same towards the feet alone.
        value_rows: (V,) which coordinates are the constraint values.
        feet: Which constraint values are those of the feet.
        heights: Which are heights of knees and hips.
    """

    def __init__(self, spec: RobotSpec, mapping: BodyMap, posture_weight: float) -> None:
        """Derive them."""
        self.neutral, self.posture_weight = np.array(spec.retarget_neutral), posture_weight
        self.variables = 6 + spec.num_joints
        x, reference = ca.SX.sym("x", self.variables), ca.SX.sym("reference", 4)
        targets = ca.SX.sym("targets", 3, len(spec.keypoints))
        model = spec.pinocchio_model()
        quat = kinematics.multiply(reference, kinematics.small_rotation(x[TURN] / 4))
        base = kinematics.SymbolicPose(kinematics.rotation_of(quat), x[POSITION])
        poses = kinematics.body_poses(model, base, x[JOINTS])
        located = zip(*spec.located(spec.keypoints.values()), strict=True)
        points = [kinematics.body_position(model, poses, *point) for point in located]
        knees = [kinematics.body_position(model, poses, body)[2] for body in spec.knee_frames]
        self._number(mapping, len(points), len(knees))
        self._derive(x, ca.vertcat(reference, ca.vec(targets)), ca.vertcat(*points, *knees))
        at = (
            x,
            reference,
            ca.vertcat(*(points[column] for column in mapping.foot_keypoints)),
            spec,
        )
        self.leg_step = _leg_step(*at, posture=0.03, damping=1e-5)
        self.foot_step = _leg_step(*at, posture=0.0, damping=1e-7)

    def cost(self, x: np.ndarray, parameters: np.ndarray) -> np.ndarray:
        """Squared distances from the targets and the neutral pose (N,), m^2.

        Args:
            x: (N, n) variables.
            parameters: (N, m).
        """
        (points,) = self.coordinates(x, parameters)
        targets = parameters[:, 4:]
        off_target = points[:, : targets.shape[1]] - targets
        turned = x[:, JOINTS] - self.neutral
        return (off_target**2).sum(axis=1) + self.posture_weight * (turned**2).sum(axis=1)

    def _number(self, mapping: BodyMap, points: int, knees: int) -> None:
        """Say which coordinates are which constraint values."""
        feet = 3 * np.array(mapping.foot_keypoints)[:, None] + np.arange(3)
        hips = 3 * np.array(mapping.hip_keypoints) + 2
        self.value_rows = np.concatenate([feet.ravel(), 3 * points + np.arange(knees), hips])
        self.feet = slice(0, feet.size)
        self.heights = slice(feet.size, len(self.value_rows))
        self.knees, self.hips = knees, len(hips)

    def _derive(self, x: ca.SX, parameters: ca.SX, coordinates: ca.SX) -> None:
        off_target = coordinates[: parameters.numel() - 4] - parameters[4:]
        turned = x[JOINTS] - ca.DM(self.neutral)
        residuals = ca.vertcat(off_target, np.sqrt(self.posture_weight) * turned)
        values = coordinates[self.value_rows.tolist()]
        self.derivatives = FrameDerivatives(x, parameters, residuals, values)
        function = ca.Function("coordinates", [x, parameters], [coordinates])
        self.coordinates = BatchedFunction(function)


def _leg_step(
    x: ca.SX, reference: ca.SX, feet: ca.SX, spec: RobotSpec, *, posture: float, damping: float
) -> BatchedFunction:
    """Gauss-Newton step (J,) of the joints towards feet (3 F,) and neutral pose, the base held."""
    targets, joints = ca.SX.sym("feet", feet.numel()), x[JOINTS]
    residual = feet - targets
    if posture:
        residual = ca.vertcat(residual, posture * (joints - ca.DM(spec.retarget_neutral)))
    jacobian = ca.jacobian(residual, joints)
    normal = jacobian.T @ jacobian + damping * ca.SX.eye(joints.numel())
    step = -ca.solve(normal, jacobian.T @ residual)
    return BatchedFunction(ca.Function("leg_step", [x, reference, targets], [step]))
