"""Changes to the model before it is compiled: floor, joints, solver, contacts."""

from __future__ import annotations

import mujoco

from lacoloco.pipelines.sim.disturbances.config import Disturbances
from lacoloco.robots.spec import RobotSpec

STRIP = 0.3
"""Width of a strip of the stepped floor, m."""
STRIPS = 8
"""Strips that are up: they reach 2.4 m to either side of the origin."""
DEPTH = 0.1
"""Thickness of a strip, m."""
PGS_ITERATIONS = 100
"""Newton's ten are too few for PGS, which converges slowly."""


def change_scene(scene: mujoco.MjSpec, robot: RobotSpec, config: Disturbances) -> None:
    """Put what is constant of the disturbances into a scene."""
    _set_joints(scene, robot, config)
    if config.floor_steps > 0.0:
        _add_steps(scene, config.floor_steps)
    if config.contact_time > 0.0:
        for geom in scene.geoms:
            geom.solref = [config.contact_time, geom.solref[1]]
    if config.cone == "elliptic":
        scene.option.cone = mujoco.mjtCone.mjCONE_ELLIPTIC
    if config.solver == "pgs":
        scene.option.solver = mujoco.mjtSolver.mjSOL_PGS
        scene.option.iterations = PGS_ITERATIONS


def without_gains(model: mujoco.MjModel) -> None:
    """Turn position motors into torque motors, for a controller outside of the model."""
    model.actuator_gainprm[:, 0] = 1.0
    model.actuator_biasprm[:] = 0.0
    model.actuator_biastype[:] = mujoco.mjtBias.mjBIAS_NONE


def _set_joints(scene: mujoco.MjSpec, robot: RobotSpec, config: Disturbances) -> None:
    limits = robot.effort_limits()
    for i, name in enumerate(robot.joint_names):
        joint = scene.joint(name)
        if config.joint_friction > 0.0:
            joint.frictionloss = joint.frictionloss + config.joint_friction * limits[i]
        if config.joint_damping > 0.0:
            damping = joint.damping
            damping[0] += config.joint_damping * robot.damping[i]
            joint.damping = damping


def _add_steps(scene: mujoco.MjSpec, height: float) -> None:
    """Lower the floor by the height and lay strips on it whose tops are where it was."""
    floor = scene.geom("floor")
    floor.pos = [0.0, 0.0, -height]
    for strip in range(STRIPS):
        scene.worldbody.add_geom(
            type=mujoco.mjtGeom.mjGEOM_BOX,
            size=[STRIP / 2, 3.0, DEPTH / 2],
            pos=[(2 * strip - STRIPS + 0.5) * STRIP, 0.0, -DEPTH / 2],
            friction=floor.friction,
            solref=floor.solref,
            solimp=floor.solimp,
        )
