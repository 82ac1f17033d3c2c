"""A compiled model as MJCF with all its digits: one element per thing, no defaults, no classes.

MuJoCo's own export rounds to six digits, and Pinocchio reads fewer ways of saying a thing than
MuJoCo. So everything is written in the one way that both take for the same.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING
from xml.etree import ElementTree
from xml.etree.ElementTree import Element, SubElement

import numpy as np

if TYPE_CHECKING:
    import mujoco

MESHES = "meshes"
"""Folder of the meshes, beside the MJCF."""


@dataclass
class Canonical:
    """An MJCF being written.

    Attributes:
        root: The whole of it.
        bodies: Name -> element.
        meshes: Name of a copied file -> where it is copied from.
    """

    root: Element
    bodies: dict[str, Element] = field(default_factory=dict)
    meshes: dict[str, Path] = field(default_factory=dict)

    def text(self) -> str:
        """The MJCF."""
        ElementTree.indent(self.root)
        return ElementTree.tostring(self.root, encoding="unicode") + "\n"


def write_canonical(
    model: mujoco.MjModel,
    base: int,
    name: str,
    folder: Path,
    *,
    efforts: np.ndarray,
    fixed: Mapping[str, float],
) -> Canonical:
    """Write a robot anew.

    Bodies keep their names and their order. Every hinge turns about the origin of its body: where
    it did not, the body's frame is moved.

    Args:
        model: The model.
        base: Body with the free joint, which is called ``root_joint`` from now on.
        name: Of the robot.
        folder: Folder from which the model's mesh files are named.
        efforts: Torque limit of each of the model's joints, N.m; 0: unknown.
        fixed: Joint -> angle, rad, at which it is welded.
    """
    root = Element("mujoco", model=name)
    SubElement(root, "compiler", angle="radian", autolimits="true", meshdir=MESHES)
    assets = SubElement(root, "asset")
    canonical = Canonical(root)
    writer = _Writer(model, canonical, assets, folder, efforts, fixed)
    writer.body(base, SubElement(root, "worldbody"), np.zeros(3))
    writer.excludes()
    if not len(assets):
        root.remove(assets)
    return canonical


@dataclass
class _Writer:
    model: mujoco.MjModel
    canonical: Canonical
    assets: Element
    folder: Path
    efforts: np.ndarray
    fixed: Mapping[str, float]
    files: dict[int, str] = field(default_factory=dict)

    def body(self, body: int, parent: Element, moved: np.ndarray) -> None:
        """Write a body and all below it; ``moved`` is by how much the parent's frame was."""
        import mujoco

        m = self.model
        joint = int(m.body_jntadr[body]) if m.body_jntnum[body] else -1
        floats = joint >= 0 and m.jnt_type[joint] == mujoco.mjtJoint.mjJNT_FREE
        pos, quat, shift = m.body_pos[body] - moved, m.body_quat[body].copy(), np.zeros(3)
        if floats:
            pos, quat = np.zeros(3), np.array([1.0, 0.0, 0.0, 0.0])
        elif joint >= 0:
            shift = m.jnt_pos[joint].copy()
            turned = np.zeros(3)
            mujoco.mju_rotVecQuat(turned, shift, quat)
            pos = pos + turned
            if (angle := self.fixed.get(m.joint(joint).name)) is not None:
                turn = np.zeros(4)
                mujoco.mju_axisAngle2Quat(turn, m.jnt_axis[joint], angle)
                mujoco.mju_mulQuat(quat, quat.copy(), turn)
        name = m.body(body).name
        element = SubElement(parent, "body", {"name": name, "pos": numbers(pos), **_quat(quat)})
        self.canonical.bodies[name] = element
        self._inertial(body, element, shift)
        if floats:
            SubElement(element, "freejoint", name="root_joint")
        elif joint >= 0 and m.joint(joint).name not in self.fixed:
            self._hinge(joint, element)
        first = int(m.body_geomadr[body])
        for number in range(int(m.body_geomnum[body])):
            self._geom(first + number, element, shift, f"{name}_{number}")
        for child in range(body + 1, m.nbody):
            if m.body_parentid[child] == body:
                self.body(child, element, shift)

    def excludes(self) -> None:
        """Write the pairs of bodies that are told not to touch."""
        m = self.model
        for number in range(m.nexclude):
            pair = [
                int(m.exclude_signature[number]) >> 16,
                int(m.exclude_signature[number]) & 65535,
            ]
            names = [m.body(body).name for body in pair]
            if all(name in self.canonical.bodies for name in names):
                add_exclude(self.canonical, *names)

    def _inertial(self, body: int, element: Element, shift: np.ndarray) -> None:
        import mujoco

        m = self.model
        if m.body_mass[body] <= 0.0:
            return
        axes = np.zeros(9)
        mujoco.mju_quat2Mat(axes, m.body_iquat[body])
        turned = axes.reshape(3, 3)
        full = turned @ np.diag(m.body_inertia[body]) @ turned.T
        entries = full[[0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]]
        SubElement(
            element,
            "inertial",
            pos=numbers(m.body_ipos[body] - shift),
            mass=numbers([m.body_mass[body]]),
            fullinertia=numbers(entries),
        )

    def _hinge(self, joint: int, element: Element) -> None:
        m, dof = self.model, int(self.model.jnt_dofadr[joint])
        said = {"name": m.joint(joint).name, "axis": numbers(m.jnt_axis[joint])}
        if m.jnt_limited[joint]:
            said["range"] = numbers(m.jnt_range[joint])
        if self.efforts[joint] > 0.0:
            said["actuatorfrcrange"] = numbers([-self.efforts[joint], self.efforts[joint]])
        for key, values in (
            ("armature", m.dof_armature),
            ("damping", m.dof_damping.reshape(m.nv, -1)[:, 0]),
            ("frictionloss", m.dof_frictionloss),
        ):
            if values[dof] > 0.0:
                said[key] = numbers([values[dof]])
        SubElement(element, "joint", said)

    def _geom(self, geom: int, element: Element, shift: np.ndarray, name: str) -> None:
        import mujoco

        m, kind = self.model, mujoco.mjtGeom(self.model.geom_type[geom])
        pos, quat = m.geom_pos[geom].copy(), m.geom_quat[geom].copy()
        touches = bool(m.geom_contype[geom] or m.geom_conaffinity[geom])
        said = {"name": name, "type": kind.name.removeprefix("mjGEOM_").lower()}
        if kind == mujoco.mjtGeom.mjGEOM_MESH:
            pos, quat = _unmoved(m, int(m.geom_dataid[geom]), pos, quat)
            said["mesh"] = self._mesh(int(m.geom_dataid[geom]))
        elif said["type"] in SIZES:
            said["size"] = numbers(m.geom_size[geom][: SIZES[said["type"]]])
        else:  # planes and height fields are no part of a robot
            return
        if touches:  # hidden where there is something better to look at
            said["group"] = "3" if self._looks(int(m.geom_bodyid[geom])) else "2"
        else:
            said |= {"contype": "0", "conaffinity": "0", "group": "2"}
        material = int(m.geom_matid[geom])
        colour = m.mat_rgba[material] if material >= 0 else m.geom_rgba[geom]
        said |= {"density": "0", "rgba": numbers(np.round(colour.astype(float), 6))}
        SubElement(element, "geom", said | {"pos": numbers(pos - shift)} | _quat(quat))

    def _looks(self, body: int) -> bool:
        """Whether something of a body is only looked at."""
        m, first = self.model, int(self.model.body_geomadr[body])
        own = range(first, first + int(m.body_geomnum[body]))
        return any(not (m.geom_contype[g] or m.geom_conaffinity[g]) for g in own)

    def _mesh(self, mesh: int) -> str:
        """The name of a mesh; its file is noted to be copied."""
        m = self.model
        if mesh in self.files:
            return self.files[mesh]
        path = self.folder / m.paths[m.mesh_pathadr[mesh] :].split(b"\0", 1)[0].decode()
        name = m.mesh(mesh).name
        file = f"{name}{path.suffix.lower()}"
        self.canonical.meshes[file] = path
        self.files[mesh] = name
        scale = {} if (m.mesh_scale[mesh] == 1.0).all() else {"scale": numbers(m.mesh_scale[mesh])}
        # looked at only: a shell may be open or flat
        SubElement(self.assets, "mesh", {"name": name, "file": file, **scale, "inertia": "shell"})
        return name


SIZES = {"sphere": 1, "capsule": 2, "cylinder": 2, "box": 3, "ellipsoid": 3}
"""Kind of geom -> how many sizes it has."""


def add_exclude(canonical: Canonical, first: str, second: str) -> None:
    """Tell two bodies not to touch."""
    contact = canonical.root.find("contact")
    if contact is None:
        contact = SubElement(canonical.root, "contact")
    SubElement(contact, "exclude", body1=first, body2=second)


def numbers(values: np.ndarray | list[float]) -> str:
    """Numbers with all the digits that make them what they are."""
    return " ".join(repr(float(value) + 0.0).removesuffix(".0") for value in values)


def _quat(quat: np.ndarray) -> dict[str, str]:
    """The attribute of a rotation; none where there is none."""
    if abs(quat[0]) == 1.0:
        return {}
    return {"quat": numbers(quat)}


def _unmoved(
    model: mujoco.MjModel, mesh: int, pos: np.ndarray, quat: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Where a mesh was put before MuJoCo moved its vertices to its centre of mass."""
    import mujoco

    back_pos, back_quat, moved = np.zeros(3), np.zeros(4), np.zeros(3)
    mujoco.mju_negPose(back_pos, back_quat, model.mesh_pos[mesh], model.mesh_quat[mesh])
    turned = np.zeros(4)
    mujoco.mju_mulPose(moved, turned, pos, quat, back_pos, back_quat)
    return moved, turned
