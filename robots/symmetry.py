"""The mirror image of a robot: which joint lies where the reflection of another one would, and
whether it then turns the other way. Found from the MJCF.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from lacoloco.robots.errors import RobotError

if TYPE_CHECKING:
    import mujoco

    from lacoloco.robots.spec import RobotSpec

TOLERANCE = 1e-3
"""By how much of the robot's height two joints may miss each other's reflections, and by how much
their axes may miss being parallel."""


@dataclass(frozen=True)
class Symmetry:
    """Reflection in the robot's sagittal plane, y = 0 in the base frame.

    Attributes:
        joints: (J,) joint ``i`` of the mirrored robot is joint ``joints[i]`` of the robot.
        signs: (J,) +1 or -1: mirrored position i = signs[i] * position[joints[i]].
    """

    joints: tuple[int, ...]
    signs: tuple[float, ...]


def sagittal_symmetry(spec: RobotSpec) -> Symmetry:
    """The reflection that maps the robot onto itself.

    A turn by an angle about an axis a becomes, in the mirror M, a turn by the opposite angle about
    M a: axial vectors do not reflect like arrows.

    Raises:
        RobotError: A joint has no counterpart on the other side.
    """
    import mujoco

    model = spec.model()
    data = mujoco.MjData(model)
    data.qpos[3] = 1.0
    data.qpos[:3] = data.qpos[7:] = 0.0
    mujoco.mj_kinematics(model, data)
    anchors, axes = data.xanchor[1:] * (1, -1, 1), data.xaxis[1:] * (1, -1, 1)
    pairs = [_counterpart(model, data, *row) for row in zip(anchors, axes, strict=True)]
    for name, pair in zip(spec.joint_names, pairs, strict=True):
        if pair is None:
            raise RobotError(
                f"robot {spec.name!r}: joint {name!r} has no counterpart on the other side; a "
                "mirrored gait needs a robot with equal sides"
            )
    found = [pair for pair in pairs if pair is not None]
    return Symmetry(tuple(joint for joint, _ in found), tuple(sign for _, sign in found))


def _counterpart(
    model: mujoco.MjModel, data: mujoco.MjData, anchor: np.ndarray, axis: np.ndarray
) -> tuple[int, float] | None:
    """The joint at a reflected anchor about a reflected axis, and the sign of its turning."""
    near = np.linalg.norm(data.xanchor[1:] - anchor, axis=1) <= TOLERANCE * model.stat.extent
    along = data.xaxis[1:] @ axis
    fits = np.flatnonzero(near & (np.abs(along) >= 1.0 - TOLERANCE))
    if len(fits) != 1:
        return None
    return int(fits[0]), float(-np.sign(along[fits[0]]))
