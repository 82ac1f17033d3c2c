"""Read an MJCF or URDF as it is published: one robot, whose colliders are primitives."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING
from xml.etree import ElementTree

from lacoloco.robots.errors import RobotError
from lacoloco.robots.importing import urdf
from lacoloco.robots.importing.meshes import fit_colliders, leave_out_unread, weigh_nothing

if TYPE_CHECKING:
    import mujoco


@dataclass
class Source:
    """A published robot, read.

    Attributes:
        file: What was read.
        model: It, compiled; its base has a free joint, and no mesh of it collides.
        base: Id of the body with the free joint.
        speeds: Joint -> speed limit, rad/s, where the file says one.
        self_collision: Whether its own shapes touch each other.
        notes: What was left out or changed on the way, a line each.
    """

    file: Path
    model: mujoco.MjModel
    base: int
    speeds: Mapping[str, float] = field(default_factory=dict)
    self_collision: bool = True
    notes: list[str] = field(default_factory=list)


def read_source(file: Path, converted: Path) -> Source:
    """Read a file of either kind.

    Args:
        file: MJCF or URDF; a scene with floor and lights will do, too.
        converted: Folder for meshes of kinds that MuJoCo does not read, rewritten as OBJ.

    Raises:
        RobotError: It cannot be read, or holds no robot with a floating base and hinges.
    """
    import mujoco

    if not file.is_file():
        raise RobotError(f"{file}: no such file; give an MJCF or a URDF")
    mujoco.set_mju_user_warning(lambda warning: None)
    notes: list[str] = []
    speeds: Mapping[str, float] = {}
    try:
        if ElementTree.parse(file).getroot().tag == "robot":
            text, speeds = urdf.prepare(file, converted, notes)
            spec = mujoco.MjSpec.from_string(text)
            for geom in spec.geoms:  # a link weighs what its inertial says, and nothing without one
                geom.mass, geom.density = 0.0, 0.0
        else:
            # absolute: MuJoCo names meshes from here, not from the folder of the file
            spec = mujoco.MjSpec.from_file(os.path.abspath(file))
    except (OSError, ValueError, ElementTree.ParseError) as error:
        raise RobotError(f"{file}: cannot be read: {_line(error)}") from error
    leave_out_unread(spec, file.parent, notes)
    weigh_nothing(spec)
    base = _base(spec, file)
    touching = _touch_each_other(spec)
    fit_colliders(spec, notes)
    model = _compile(spec, file, notes)
    _require_hinges(model, file)
    return Source(file, model, model.body(base).id, speeds, touching, notes)


def _base(spec: mujoco.MjSpec, file: Path) -> str:
    """Name of the body that floats: the one of the world's bodies with the most below it."""
    import mujoco

    free = mujoco.mjtJoint.mjJNT_FREE
    for number, body in enumerate(spec.bodies):
        body.name = body.name or f"body{number}"
    tops = list(spec.worldbody.bodies)
    if not tops:
        raise RobotError(f"{file}: holds no body")
    base = max(tops, key=lambda body: len(body.find_all("joint")))
    joints = list(base.joints)
    if not joints:
        base.add_freejoint(name="root_joint")
        for key in list(spec.keys):  # they are of a robot that is bolted to the world
            spec.delete(key)
    elif [joint.type for joint in joints] != [free]:
        raise RobotError(
            f"{file}: the base {base.name!r} moves on joint {joints[0].name!r}; expected a free"
            " joint, or none"
        )
    return str(base.name)


def _touch_each_other(spec: mujoco.MjSpec) -> bool:
    """Whether some collider may touch another one, by their contact bits."""
    bits = [(g.contype, g.conaffinity) for body in spec.bodies[1:] for g in body.geoms]
    kinds, affinities = 0, 0
    for kind, affinity in bits:
        kinds, affinities = kinds | kind, affinities | affinity
    return bool(kinds & affinities)


def _compile(spec: mujoco.MjSpec, file: Path, notes: list[str]) -> mujoco.MjModel:
    try:
        return spec.compile()
    except ValueError as error:
        if "inertia" not in str(error):
            raise RobotError(f"{file}: MuJoCo cannot compile it: {_line(error)}") from error
    for body in spec.bodies:
        if not 0.0 <= body.mass < float("inf"):
            raise RobotError(f"{file}: body {body.name!r} weighs {body.mass:g} kg; expected a mass")
    spec.compiler.balanceinertia = True
    spec.compiler.boundmass, spec.compiler.boundinertia = 1e-6, 1e-9
    notes.append("inertias that no solid body has were replaced by the nearest that one can have")
    try:
        return spec.compile()
    except ValueError as error:
        raise RobotError(f"{file}: MuJoCo cannot compile it: {_line(error)}") from error


def _require_hinges(model: mujoco.MjModel, file: Path) -> None:
    import mujoco

    kinds = {
        int(mujoco.mjtJoint.mjJNT_SLIDE): "a slide",
        int(mujoco.mjtJoint.mjJNT_BALL): "a ball joint",
    }
    for joint in range(model.njnt):
        kind, name = int(model.jnt_type[joint]), model.joint(joint).name
        if kind in kinds:
            raise RobotError(f"{file}: joint {name!r} is {kinds[kind]}; only hinges can be driven")
        hinge = kind == int(mujoco.mjtJoint.mjJNT_HINGE)
        if hinge and model.body_jntnum[model.jnt_bodyid[joint]] > 1:
            raise RobotError(f"{file}: joint {name!r} shares its body with another one; split it")
        if hinge and model.qpos0[model.jnt_qposadr[joint]] != 0.0:
            raise RobotError(f"{file}: joint {name!r} has a `ref`; expected angles from 0")
        if not name and hinge:
            raise RobotError(f"{file}: a joint has no name; give it one")


def _line(error: Exception) -> str:
    return " ".join(str(error).split())
