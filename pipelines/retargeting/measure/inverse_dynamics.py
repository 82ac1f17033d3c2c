"""The torques that a clip would take: inverse dynamics, the ground pushing where the feet stand."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from lacoloco.datasets.clip import Clip
from lacoloco.pipelines.retargeting.measure.contact_forces import distribute
from lacoloco.robots.spec import RobotSpec

BASE = 6
"""Degrees of freedom of the base, which no motor drives."""


@dataclass(frozen=True)
class Efforts:
    """What moves the robot through T frames."""

    torques: np.ndarray
    """(T, J) N.m, of the motors."""
    forces: np.ndarray
    """(T, P, 3) N, world, of the ground on the points of the feet."""
    missing: np.ndarray
    """(T,) N, what the ground cannot give: pulls, pushes without a foot there, friction."""


def inverse_dynamics(spec: RobotSpec, clip: Clip, contacts: np.ndarray) -> Efforts:
    """Torques and forces of a clip, from its accelerations (Featherstone's recursive Newton-Euler).

    Args:
        spec: The robot.
        clip: At least three frames, else everything is taken to rest.
        contacts: (T, P) bool, at which points of the feet the ground may push.
    """
    model = spec.pinocchio_model()
    positions = _configurations(clip)
    velocities, accelerations = _derivatives(model, positions, clip.fps)
    bodies, offsets = spec.located(spec.foot_points)
    data = model.createData()
    feet = [model.getFrameId(body, pin.FrameType.BODY) for body in bodies]
    below = pin.skew(np.array([0.0, 0.0, -spec.foot_radius()]))
    needed = np.empty((clip.frames, model.nv))
    reach = np.empty((clip.frames, len(feet), 3, model.nv))
    for frame, q in enumerate(positions):
        needed[frame] = pin.rnea(model, data, q, velocities[frame], accelerations[frame])
        pin.computeJointJacobians(model, data, q)
        pin.updateFramePlacements(model, data)
        for index, foot in enumerate(feet):
            both = pin.getFrameJacobian(model, data, foot, pin.LOCAL_WORLD_ALIGNED)
            arm = below + pin.skew(data.oMf[foot].rotation @ np.array(offsets[index]))
            reach[frame, index] = both[:3] - arm @ both[3:]
    return _balanced(spec, needed, reach, contacts)


def _balanced(
    spec: RobotSpec, needed: np.ndarray, reach: np.ndarray, contacts: np.ndarray
) -> Efforts:
    """Split generalised forces (T, nv) into the ground's, by its Jacobians, and the motors'."""
    maps = np.moveaxis(reach[..., :BASE], -1, 1)
    # Torques count like forces at the size of the robot; all relative to its weight.
    arms = np.repeat([1.0, 1.0 / spec.default_height()], 3)
    forces = spec.weight() * distribute(
        maps * arms[:, None, None], needed[:, :BASE] * arms / spec.weight(), contacts
    )
    given = np.einsum("tfiv,tfi->tv", reach, forces)
    missing = np.linalg.norm((needed - given)[:, :3], axis=1)
    return Efforts((needed - given)[:, BASE:], forces, missing)


def _configurations(clip: Clip) -> np.ndarray:
    """(T, nq) of Pinocchio, whose quaternions are xyzw."""
    return np.concatenate([clip.root_pos, np.roll(clip.root_quat, -1, 1), clip.joint_pos], axis=1)


def _derivatives(
    model: pin.Model, positions: np.ndarray, fps: float
) -> tuple[np.ndarray, np.ndarray]:
    """Velocities and accelerations (T, nv) by central differences, held at the ends."""
    steps = np.zeros((len(positions) + 1, model.nv))
    for frame in range(1, len(positions)):
        steps[frame] = pin.difference(model, positions[frame - 1], positions[frame]) * fps
    steps[0], steps[-1] = steps[1], steps[-2]
    velocities = (steps[1:] + steps[:-1]) / 2
    accelerations = (steps[1:] - steps[:-1]) * fps
    if len(positions) > 2:
        accelerations[0], accelerations[-1] = accelerations[1], accelerations[-2]
    return velocities, accelerations
