"""What the actuators of a published model say of its motors."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from xml.etree.ElementTree import Element

    import mujoco

IMPLAUSIBLE = 5.0
"""Times weight times height, a torque that no motor of a robot has: strong ones have 0.7."""


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


def drop_implausible(root: Element, model: mujoco.MjModel, height: float) -> dict[str, float]:
    """Take limits out of an MJCF that no motor can have: some files say 1000 N.m for any robot.

    Args:
        root: The MJCF; loses them.
        model: The same, compiled.
        height: Of the base in standing, m.

    Returns:
        Joint -> what the file said, N.m.
    """
    weight = float(model.body_mass.sum() * np.linalg.norm(model.opt.gravity))
    said = {
        model.joint(joint).name: float(model.jnt_actfrcrange[joint, 1])
        for joint in range(1, model.njnt)
        if model.jnt_actfrcrange[joint, 1] > IMPLAUSIBLE * weight * height
    }
    for element in root.iter("joint"):
        if element.get("name") in said:
            del element.attrib["actuatorfrcrange"]
    return said


def _is_torque(model: mujoco.MjModel, actuator: int) -> bool:
    """Whether the control is the torque, and no target."""
    import mujoco

    return bool(model.actuator_biastype[actuator] == mujoco.mjtBias.mjBIAS_NONE)
