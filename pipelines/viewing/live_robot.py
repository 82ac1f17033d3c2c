"""A robot in a live scene of viser: its geoms as its MJCF has them, moved body by body."""

from __future__ import annotations

from typing import TYPE_CHECKING

import mujoco
import numpy as np

from lacoloco.pipelines.viewing.drawn_scene import LAST_DRAWN_GROUP
from lacoloco.robots.spec import RobotSpec

if TYPE_CHECKING:
    import trimesh
    import viser

WORLD = "/world"
"""Node of everything that has a place; it moves so that the robot stays before the camera."""


class LiveRobot:
    """One robot below the node `WORLD`, which keeps the robot's base over the origin."""

    def __init__(self, server: viser.ViserServer, spec: RobotSpec) -> None:
        """Add the bodies, standing at the origin."""
        self._model = spec.model()
        self._data = mujoco.MjData(self._model)
        self._world = server.scene.add_frame(WORLD, show_axes=False)
        self._bodies = {
            body: server.scene.add_frame(f"{WORLD}/robot/{body}", show_axes=False)
            for body in range(1, self._model.nbody)
        }
        for geom in range(self._model.ngeom):
            self._add_geom(server, geom)
        self.place(spec.default_qpos())

    def place(self, qpos: np.ndarray) -> None:
        """Show a pose (7 + J,): position [m], orientation wxyz, joints [rad]."""
        self._data.qpos[:] = qpos
        mujoco.mj_kinematics(self._model, self._data)
        self._world.position = (-float(qpos[0]), -float(qpos[1]), 0.0)
        for body, frame in self._bodies.items():
            frame.position, frame.wxyz = self._data.xpos[body], self._data.xquat[body]

    def _add_geom(self, server: viser.ViserServer, geom: int) -> None:
        """Add a geom as MuJoCo would draw it; nothing for one that it would not."""
        model = self._model
        mesh, body, material = (
            geom_mesh(model, geom),
            model.geom_bodyid[geom],
            model.geom_matid[geom],
        )
        colour = model.mat_rgba[material] if material >= 0 else model.geom_rgba[geom]
        red, green, blue, alpha = (float(value) for value in colour)
        if mesh is None or body == 0 or alpha == 0.0 or model.geom_group[geom] > LAST_DRAWN_GROUP:
            return
        server.scene.add_mesh_simple(
            f"{WORLD}/robot/{body}/{geom}",
            mesh.vertices,
            mesh.faces,
            color=(round(255 * red), round(255 * green), round(255 * blue)),
            opacity=None if alpha == 1.0 else alpha,
            position=model.geom_pos[geom],
            wxyz=model.geom_quat[geom],
        )


def geom_mesh(model: mujoco.MjModel, geom: int) -> trimesh.Trimesh | None:
    """The triangles of a geom in its own frame [m]; None for a plane, which has no size."""
    import trimesh
    from trimesh import creation

    kind, size = model.geom_type[geom], model.geom_size[geom]
    if kind == mujoco.mjtGeom.mjGEOM_BOX:
        return creation.box(extents=2.0 * size)
    if kind == mujoco.mjtGeom.mjGEOM_SPHERE:
        return creation.icosphere(subdivisions=2, radius=size[0])
    if kind == mujoco.mjtGeom.mjGEOM_ELLIPSOID:
        ball = creation.icosphere(subdivisions=2, radius=1.0)
        ball.apply_scale(size)
        return ball
    if kind == mujoco.mjtGeom.mjGEOM_CYLINDER:
        return creation.cylinder(radius=size[0], height=2.0 * size[1], sections=24)
    if kind == mujoco.mjtGeom.mjGEOM_CAPSULE:
        return creation.capsule(radius=size[0], height=2.0 * size[1], count=[16, 16])
    if kind == mujoco.mjtGeom.mjGEOM_MESH:
        mesh = model.geom_dataid[geom]
        first, face = model.mesh_vertadr[mesh], model.mesh_faceadr[mesh]
        vertices = model.mesh_vert[first : first + model.mesh_vertnum[mesh]]
        faces = model.mesh_face[face : face + model.mesh_facenum[mesh]]
        return trimesh.Trimesh(vertices, faces, process=False)
    return None
