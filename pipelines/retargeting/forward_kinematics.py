"""Forward kinematics in CasADi, built from Pinocchio's numeric model.

The `pin` wheel of PyPI comes without `pinocchio.casadi`. The chain of a robot of one-degree-of-
freedom joints behind a free base is short enough to write out here; the tests hold it against
Pinocchio. Quaternions are (w, x, y, z); a pose maps body vectors into the world.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np
import pinocchio as pin

from lacoloco.pipelines.errors import StageError

FREE_BASE = 7
"""Entries of Pinocchio's configuration before the first joint: position and quaternion."""


@dataclass(frozen=True)
class SymbolicPose:
    """Rotation (3, 3) and position (3,) [m] of a body in the world, as CasADi expressions."""

    rotation: ca.SX
    position: ca.SX


def rotation_of(quat: ca.SX) -> ca.SX:
    """Rotation matrix (3, 3) of a unit quaternion (4,), wxyz."""
    w, x, y, z = ca.vertsplit(quat)
    return ca.vertcat(
        ca.horzcat(1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)),
        ca.horzcat(2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)),
        ca.horzcat(2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)),
    )


def multiply(first: ca.SX, second: ca.SX) -> ca.SX:
    """Hamilton product of two quaternions (4,), wxyz."""
    w, v = first[0], first[1:]
    return ca.vertcat(
        w * second[0] - ca.dot(v, second[1:]),
        w * second[1:] + second[0] * v + ca.cross(v, second[1:]),
    )


def small_rotation(vector: ca.SX) -> ca.SX:
    """Unit quaternion of modified Rodrigues parameters (3,), axis * tan(angle / 4).

    Rational and smooth up to a full turn, so it needs no case for the angle 0.
    """
    square = ca.dot(vector, vector)
    return ca.vertcat(1 - square, 2 * vector) / (1 + square)


def body_poses(model: pin.Model, base: SymbolicPose, joint_pos: ca.SX) -> list[SymbolicPose]:
    """Poses of all joints of a model, indexed like `model.joints`.

    Args:
        model: A free base followed by revolute or prismatic joints.
        base: Pose of the base.
        joint_pos: (J,) positions in the order of the model, rad or m.
    """
    world = SymbolicPose(ca.SX.eye(3), ca.SX.zeros(3))
    poses = [world, base]
    for index in range(2, model.njoints):
        joint, placement = model.joints[index], model.jointPlacements[index]
        value = joint_pos[joint.idx_q - FREE_BASE]
        parent = poses[model.parents[index]]
        position = parent.position + parent.rotation @ ca.DM(placement.translation)
        rotation = parent.rotation @ ca.DM(placement.rotation)
        linear, angular = _motion_axis(model, joint)
        position += rotation @ ca.DM(linear) * value
        poses.append(SymbolicPose(rotation @ _turn(angular, value), position))
    return poses


def body_position(
    model: pin.Model,
    poses: Sequence[SymbolicPose],
    body: str,
    offset: Sequence[float] = (0.0, 0.0, 0.0),
) -> ca.SX:
    """World position (3,) of a point of a body, m.

    Args:
        model: Model of the poses.
        poses: From `body_poses`.
        body: Name of the body.
        offset: The point in the frame of the body, m.

    Raises:
        StageError: The model has no body of that name.
    """
    frame = model.frames[_body_frame(model, body)]
    pose = poses[frame.parentJoint]
    return pose.position + pose.rotation @ ca.DM(frame.placement.act(np.asarray(offset)))


class BodyPositions:
    """World positions of some bodies for many configurations at once."""

    def __init__(
        self,
        model: pin.Model,
        bodies: Sequence[str],
        offsets: Sequence[Sequence[float]] | None = None,
    ) -> None:
        """Build the function for these bodies.

        Args:
            model: Model of the robot.
            bodies: Names of K bodies.
            offsets: A point in the frame of each, m; default: their origins.

        Raises:
            StageError: The model lacks one of them.
        """
        offsets = offsets or [(0.0, 0.0, 0.0)] * len(bodies)
        position, quat = ca.SX.sym("position", 3), ca.SX.sym("quat", 4)
        joints = ca.SX.sym("joints", model.nq - FREE_BASE)
        poses = body_poses(model, SymbolicPose(rotation_of(quat), position), joints)
        pairs = zip(bodies, offsets, strict=True)
        points = [body_position(model, poses, body, offset) for body, offset in pairs]
        self._function = ca.Function("points", [position, quat, joints], [ca.vertcat(*points)])
        self._count = len(bodies)

    def __call__(self, root_pos: np.ndarray, quat: np.ndarray, joint_pos: np.ndarray) -> np.ndarray:
        """Evaluate T configurations.

        Args:
            root_pos: (T, 3) m.
            quat: (T, 4) wxyz, unit.
            joint_pos: (T, J) rad.

        Returns:
            (T, K, 3) m.
        """
        points = self._function(root_pos.T, quat.T, joint_pos.T)
        return np.array(points).T.reshape(len(root_pos), self._count, 3)


def _body_frame(model: pin.Model, body: str) -> int:
    if not model.existFrame(body, pin.FrameType.BODY):
        known = ", ".join(f.name for f in model.frames if f.type == pin.FrameType.BODY)
        raise StageError(f"robot model {model.name!r} has no body {body!r}; it has {known}")
    return model.getFrameId(body, pin.FrameType.BODY)


def _motion_axis(model: pin.Model, joint: pin.JointModel) -> tuple[np.ndarray, np.ndarray]:
    """Constant unit twist (linear, angular) of a one-degree-of-freedom joint in its own frame."""
    data = joint.createData()
    joint.calc(data, pin.neutral(model))
    twist = np.asarray(data.S, dtype=float).reshape(6)
    return twist[:3], twist[3:]


def _turn(axis: np.ndarray, angle: ca.SX) -> ca.SX:
    """Rodrigues' formula for a constant unit axis; the identity for the zero axis."""
    cross = pin.skew(axis)
    return ca.SX.eye(3) + ca.sin(angle) * ca.DM(cross) + (1 - ca.cos(angle)) * ca.DM(cross @ cross)
