"""How far MuJoCo and Pinocchio differ on the same MJCF."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    import mujoco
    import pinocchio

    from lacoloco.robots.spec import RobotSpec


@dataclass(frozen=True)
class Disagreement:
    """Largest absolute differences over bodies and poses; all zero for perfect agreement.

    Attributes:
        position: Body positions in the world, m.
        rotation: Entries of body rotation matrices.
        mass_matrix: Entries of the joint-space inertia, armature included, kg.m2.
        gravity: Generalised gravity forces, N and N.m.
        total_mass: kg.
        joint_limits: rad.
        effort_limits: N.m.
    """

    position: float
    rotation: float
    mass_matrix: float
    gravity: float
    total_mass: float
    joint_limits: float
    effort_limits: float


def compare_engines(spec: RobotSpec, *, poses: int, seed: int) -> Disagreement:
    """Compare the engines at random poses: base anywhere, joints within their ranges."""
    import mujoco

    model, pin_model = spec.model(), spec.pinocchio_model()
    data, pin_data = mujoco.MjData(model), pin_model.createData()
    lower, upper = spec.joint_limits()
    rng = np.random.default_rng(seed)
    worst = np.zeros(4)
    for _ in range(poses):
        quat = rng.normal(size=4)
        data.qpos[:3] = rng.uniform(-1, 1, 3)
        data.qpos[3:7] = quat / np.linalg.norm(quat)
        data.qpos[7:] = rng.uniform(lower, upper)
        mujoco.mj_forward(model, data)
        q = to_pinocchio(data.qpos)
        differences = (
            *_kinematics(model, data, pin_model, pin_data, q),
            _mass_matrix(model, data, pin_model, pin_data, q),
            _gravity(model, data, pin_model, pin_data, q),
        )
        worst = np.maximum(worst, differences)
    limits = np.stack(
        [lower - pin_model.lowerPositionLimit[7:], upper - pin_model.upperPositionLimit[7:]]
    )[:, upper > lower]
    efforts = spec.effort_limits()
    stated = efforts > 0.0  # a limit that the MJCF lacks is a mistake of its own
    position, rotation, mass_matrix, gravity = (float(w) for w in worst)
    return Disagreement(
        position,
        rotation,
        mass_matrix,
        gravity,
        total_mass=abs(spec.total_mass() - sum(i.mass for i in pin_model.inertias)),
        joint_limits=float(np.abs(limits).max(initial=0.0)),
        effort_limits=float(np.abs(efforts - pin_model.effortLimit[6:])[stated].max(initial=0.0)),
    )


def to_pinocchio(qpos: np.ndarray) -> np.ndarray:
    """MuJoCo's qpos (xyz, wxyz, joints) in Pinocchio's order (xyz, xyzw, joints)."""
    return np.concatenate([qpos[:3], qpos[4:7], qpos[3:4], qpos[7:]])


def _kinematics(
    model: mujoco.MjModel,
    data: mujoco.MjData,
    pin_model: pinocchio.Model,
    pin_data: pinocchio.Data,
    q: np.ndarray,
) -> tuple[float, float]:
    import pinocchio

    pinocchio.framesForwardKinematics(pin_model, pin_data, q)
    position = rotation = 0.0
    for body in range(1, model.nbody):
        frame = pin_model.getFrameId(model.body(body).name, pinocchio.FrameType.BODY)
        placement = pin_data.oMf[frame]
        position = max(position, np.abs(placement.translation - data.xpos[body]).max())
        rotation = max(rotation, np.abs(placement.rotation.ravel() - data.xmat[body]).max())
    return position, rotation


def _mass_matrix(
    model: mujoco.MjModel,
    data: mujoco.MjData,
    pin_model: pinocchio.Model,
    pin_data: pinocchio.Data,
    q: np.ndarray,
) -> float:
    """Largest difference of the joint-space inertia M.

    Pinocchio's base velocity is in the base frame, the linear part of MuJoCo's in the world:
    v_mujoco = T v_pinocchio with T = diag(R, 1), hence M_pinocchio = T^T M_mujoco T.
    """
    import mujoco
    import pinocchio

    dense = np.zeros((model.nv, model.nv))
    mujoco.mj_fullM(model, data, dense)
    t = np.eye(model.nv)
    t[:3, :3] = data.xmat[1].reshape(3, 3)
    upper = np.triu(pinocchio.crba(pin_model, pin_data, q))
    theirs = upper + np.triu(upper, 1).T
    return float(np.abs(t.T @ dense @ t - theirs).max())


def _gravity(
    model: mujoco.MjModel,
    data: mujoco.MjData,
    pin_model: pinocchio.Model,
    pin_data: pinocchio.Data,
    q: np.ndarray,
) -> float:
    """Largest difference of the bias forces at rest, which are those of gravity."""
    import pinocchio

    ours = data.qfrc_bias.copy()
    ours[:3] = data.xmat[1].reshape(3, 3).T @ ours[:3]
    theirs = pinocchio.computeGeneralizedGravity(pin_model, pin_data, q)
    return float(np.abs(ours - theirs).max())
