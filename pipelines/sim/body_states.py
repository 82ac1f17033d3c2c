"""Where all bodies of a robot are, and how fast, over the frames of a motion: kinematics alone."""

from __future__ import annotations

from dataclasses import dataclass

import mujoco
import numpy as np

from lacoloco.robots.spec import RobotSpec


@dataclass(frozen=True)
class BodyStates:
    """Bodies of a robot over T frames."""

    names: tuple[str, ...]
    """The B bodies in the order of the MJCF, the base first."""
    pos: np.ndarray
    """(T, B, 3) origins, world, m."""
    quat: np.ndarray
    """(T, B, 4) wxyz, body to world."""


@dataclass(frozen=True)
class BodyVelocities:
    """How fast the origins of the bodies of `BodyStates` are."""

    lin_vel: np.ndarray
    """(T, B, 3) world, m/s."""
    ang_vel: np.ndarray
    """(T, B, 3) world, rad/s."""


def body_states(
    spec: RobotSpec, root_pos: np.ndarray, root_quat: np.ndarray, joint_pos: np.ndarray
) -> BodyStates:
    """Where all bodies of the robot are.

    Args:
        spec: The robot.
        root_pos: (T, 3) m.
        root_quat: (T, 4) wxyz.
        joint_pos: (T, J) rad, in the robot's order.
    """
    model = spec.model()
    data = mujoco.MjData(model)
    names = tuple(model.body(index).name for index in range(1, model.nbody))
    pos, quat = np.empty((len(root_pos), len(names), 3)), np.empty((len(root_pos), len(names), 4))
    for frame, qpos in enumerate(np.hstack([root_pos, root_quat, joint_pos])):
        data.qpos[:] = qpos
        mujoco.mj_kinematics(model, data)
        pos[frame], quat[frame] = data.xpos[1:], data.xquat[1:]
    return BodyStates(names, pos, quat)


def body_velocities(spec: RobotSpec, qpos: np.ndarray, qvel_b: np.ndarray) -> BodyVelocities:
    """How fast all bodies of the robot are.

    Args:
        spec: The robot.
        qpos: (T, 7 + J) position, orientation wxyz, joints.
        qvel_b: (T, 6 + J) linear and angular velocity in the base frame, joint velocities.
    """
    model = spec.model()
    data = mujoco.MjData(model)
    bodies = range(1, model.nbody)
    result, one = np.empty((len(qpos), len(bodies), 6)), np.empty(6)
    for frame in range(len(qpos)):
        data.qpos[:], data.qvel[:] = qpos[frame], qvel_b[frame]
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        # MuJoCo has the base's linear velocity in the world, its angular velocity in the base.
        data.qvel[:3] = data.xmat[1].reshape(3, 3) @ qvel_b[frame, :3]
        mujoco.mj_comVel(model, data)
        for index, body in enumerate(bodies):
            mujoco.mj_objectVelocity(model, data, mujoco.mjtObj.mjOBJ_XBODY, body, one, 0)
            result[frame, index] = one
    return BodyVelocities(lin_vel=result[..., 3:], ang_vel=result[..., :3])
