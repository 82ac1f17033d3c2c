"""Lengths that follow from the shapes of a model."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from lacoloco.robots.errors import RobotError

if TYPE_CHECKING:
    import mujoco


def colliding_geoms(model: mujoco.MjModel, bodies: Sequence[str]) -> list[int]:
    """Ids of the geoms of ``bodies`` that can touch something.

    Raises:
        RobotError: A body is not in the model, or has no such geom.
    """
    ids: list[int] = []
    for name in bodies:
        try:
            body = model.body(name)
        except KeyError:
            raise RobotError(
                f"body {name!r} is not in the MJCF; fix the spec or the file"
            ) from None
        first, count = int(body.geomadr[0]), int(body.geomnum[0])
        own = [
            g
            for g in range(first, first + count)
            if model.geom_contype[g] or model.geom_conaffinity[g]
        ]
        if not own:
            raise RobotError(f"body {name!r} has no colliding geom; add one to the MJCF")
        ids += own
    return ids


def colliding_meshes(model: mujoco.MjModel) -> list[int]:
    """Ids of the geoms that are meshes and can touch something; only primitives should."""
    import mujoco

    touches = (model.geom_contype | model.geom_conaffinity) != 0
    meshes = model.geom_type == mujoco.mjtGeom.mjGEOM_MESH
    return [int(g) for g in np.flatnonzero(touches & meshes)]


def foot_geoms(model: mujoco.MjModel, feet: Sequence[str]) -> tuple[list[int], list[int]]:
    """Ids of all geoms of the feet, and for each the row of its foot in ``feet``."""
    rows = {model.body(name).id: row for row, name in enumerate(feet)}
    geoms = [g for g in range(model.ngeom) if int(model.geom_bodyid[g]) in rows]
    return geoms, [rows[int(model.geom_bodyid[g])] for g in geoms]


def lowest_point(model: mujoco.MjModel, data: mujoco.MjData, geom: int) -> float:
    """World z of the lowest point of a sphere, capsule, cylinder or box, m.

    Needs the kinematics of ``data``. The extent below the centre is the support function of the
    shape along -z; c is the z component of each of its axes.
    """
    import mujoco

    size, c = model.geom_size[geom], np.abs(data.geom_xmat[geom].reshape(3, 3)[2])
    kind = mujoco.mjtGeom(model.geom_type[geom])
    if kind == mujoco.mjtGeom.mjGEOM_SPHERE:
        extent = size[0]
    elif kind == mujoco.mjtGeom.mjGEOM_CAPSULE:
        extent = size[0] + size[1] * c[2]
    elif kind == mujoco.mjtGeom.mjGEOM_CYLINDER:
        extent = size[0] * np.sqrt(max(0.0, 1.0 - c[2] ** 2)) + size[1] * c[2]
    elif kind == mujoco.mjtGeom.mjGEOM_BOX:
        extent = float(size @ c)
    else:
        raise RobotError(f"geom {geom} is a {kind.name}: use spheres, capsules, cylinders, boxes")
    return float(data.geom_xpos[geom, 2] - extent)


def standing_height(model: mujoco.MjModel, joint_pos: np.ndarray, feet: Sequence[str]) -> float:
    """Base height that puts the lowest point of the feet on the floor, base upright, m.

    Args:
        model: The bare robot.
        joint_pos: Joint positions, (J,), rad.
        feet: Names of the foot bodies.
    """
    import mujoco

    data = mujoco.MjData(model)
    data.qpos[:7] = [0, 0, 0, 1, 0, 0, 0]
    data.qpos[7:] = joint_pos
    mujoco.mj_kinematics(model, data)
    return -min(lowest_point(model, data, g) for g in colliding_geoms(model, feet))


def foot_radius(model: mujoco.MjModel, feet: Sequence[str]) -> float:
    """Largest first size (radius) among the foot geoms, m."""
    return float(max(model.geom_size[g, 0] for g in colliding_geoms(model, feet)))
