"""What the actuators of a published model say of its motors."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    import mujoco


def driven(model: mujoco.MjModel) -> dict[int, int]:
    """Joint -> actuator, of those that drive a joint directly."""
    import mujoco

    kinds = (int(mujoco.mjtTrn.mjTRN_JOINT), int(mujoco.mjtTrn.mjTRN_JOINTINPARENT))
    return {
        int(model.actuator_trnid[a, 0]): a
        for a in range(model.nu)
        if int(model.actuator_trntype[a]) in kinds
    }


def unpowered(model: mujoco.MjModel) -> set[str]:
    """Names of the hinges without an actuator, where others have one.

    A file without any actuator, as every URDF, has a motor on every hinge.
    """
    import mujoco

    motors = driven(model)
    if not motors:
        return set()
    hinge = mujoco.mjtJoint.mjJNT_HINGE
    return {
        model.joint(j).name
        for j in range(model.njnt)
        if model.jnt_type[j] == hinge and j not in motors
    }


def read_efforts(model: mujoco.MjModel) -> np.ndarray:
    """Torque limit of every joint, (njnt,), N.m; 0: it says none.

    The smallest of: the joint's ``actuatorfrcrange``, the actuator's ``forcerange``, and of a
    motor, whose control is a torque, its ``ctrlrange``; the latter two times the gear.
    """
    efforts = np.zeros(model.njnt)
    motors = driven(model)
    for joint in range(model.njnt):
        limits = []
        if model.jnt_actfrclimited[joint]:
            limits.append(float(np.abs(model.jnt_actfrcrange[joint]).max()))
        actuator = motors.get(joint)
        if actuator is not None:
            gear = abs(float(model.actuator_gear[actuator, 0]))
            if model.actuator_forcelimited[actuator]:
                limits.append(gear * float(np.abs(model.actuator_forcerange[actuator]).max()))
            if model.actuator_ctrllimited[actuator] and _is_torque(model, actuator):
                gain = abs(float(model.actuator_gainprm[actuator, 0]))
                limits.append(gear * gain * float(np.abs(model.actuator_ctrlrange[actuator]).max()))
        efforts[joint] = min(limits, default=0.0)
    return efforts


def _is_torque(model: mujoco.MjModel, actuator: int) -> bool:
    """Whether the control is the torque, and no target."""
    import mujoco

    return bool(model.actuator_biastype[actuator] == mujoco.mjtBias.mjBIAS_NONE)
