"""Meshes of a published robot: those to look at are kept, those that collide become primitives."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    import mujoco

READ_BY_MUJOCO = (".obj", ".stl", ".msh")
PRIMITIVES = ("SPHERE", "CAPSULE", "CYLINDER", "BOX")
THIN = 1e-3
"""m; a mesh that is thinner is made so thick before a primitive is fitted to it."""


def as_obj(file: Path, folder: Path) -> Path | None:
    """Rewrite a mesh of any kind that Pinocchio's library reads (COLLADA and others) as OBJ.

    Args:
        file: The mesh.
        folder: Where the OBJ goes.

    Returns:
        The OBJ, or None if the file cannot be read.
    """
    import coal

    try:
        mesh = coal.MeshLoader().load(str(file), np.ones(3))
    except (RuntimeError, ValueError):
        return None
    vertices = np.array([mesh.vertex(i) for i in range(mesh.num_vertices)]).reshape(-1, 3)
    faces = [mesh.tri_indices(i) for i in range(mesh.num_tris)]
    if not faces:
        return None
    folder.mkdir(parents=True, exist_ok=True)
    target = folder / f"{file.parent.name}_{file.stem}.obj"
    lines = [f"v {x:.9g} {y:.9g} {z:.9g}" for x, y, z in vertices]
    lines += [f"f {face[0] + 1} {face[1] + 1} {face[2] + 1}" for face in faces]
    target.write_text("\n".join(lines) + "\n")
    return target


def leave_out_unread(spec: mujoco.MjSpec, folder: Path, notes: list[str]) -> None:
    """Delete textures, meshes without a file that MuJoCo reads, and the shapes made of those."""
    for material in spec.materials:
        material.textures = [""] * len(material.textures)
    for texture in list(spec.textures):
        spec.delete(texture)
    gone: dict[str, str] = {}
    for mesh in list(spec.meshes):
        path = folder / (spec.meshdir or "") / mesh.file
        if mesh.file and not (path.is_file() and path.suffix.lower() in READ_BY_MUJOCO):
            gone[mesh.name or Path(mesh.file).stem] = mesh.file
    if not gone:
        return
    notes.append(f"left out, no such file or none that can be read: {', '.join(gone.values())}")
    for geom in list(spec.geoms):
        if geom.meshname in gone:
            spec.delete(geom)
    for mesh in list(spec.meshes):
        if (mesh.name or Path(mesh.file).stem) in gone:
            spec.delete(mesh)


def weigh_nothing(spec: mujoco.MjSpec) -> None:
    """Let MuJoCo take meshes that are open or flat where nothing is weighed by them.

    It refuses a mesh without volume unless it is taken for a shell.
    """
    import mujoco

    weighing = {
        geom.meshname
        for body in spec.bodies
        for geom in body.geoms
        if not body.explicitinertial and geom.density != 0.0 and geom.mass != 0.0
    }
    for mesh in spec.meshes:
        if (mesh.name or Path(mesh.file).stem) not in weighing:
            mesh.inertia = mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL


def fit_colliders(spec: mujoco.MjSpec, notes: list[str]) -> None:
    """Replace every mesh that collides by the primitive that MuJoCo fits to it best.

    What MuJoCo would collide is the mesh's convex hull. Where a body has nothing to look at, the
    mesh stays for that.
    """
    import mujoco

    spec.compiler.fitaabb = True  # as large as the mesh: a foot has to reach as far down
    fitted: dict[str, str] = {}
    solid: dict[str, str] = {}
    for body in spec.bodies:
        for geom in list(body.geoms):
            if geom.type != mujoco.mjtGeom.mjGEOM_MESH or not (geom.contype or geom.conaffinity):
                continue
            if all(g.contype or g.conaffinity for g in body.geoms):
                body.add_geom(
                    type=geom.type,
                    meshname=geom.meshname,
                    pos=geom.pos,
                    quat=geom.quat,
                    rgba=geom.rgba,
                    material=geom.material,
                    contype=0,
                    conaffinity=0,
                    density=0,
                )
            if geom.meshname not in fitted:
                solid[geom.meshname] = _solid(spec, geom.meshname)
                fitted[geom.meshname] = best_primitive(spec, solid[geom.meshname])
            kind = fitted[geom.meshname]
            geom.type = getattr(mujoco.mjtGeom, f"mjGEOM_{kind}")
            geom.meshname = solid[geom.meshname]
    if fitted:
        shapes = ", ".join(f"{mesh} ({kind.lower()})" for mesh, kind in fitted.items())
        notes.append(f"meshes that collide, replaced by primitives: {shapes}")


def best_primitive(spec: mujoco.MjSpec, mesh: str) -> str:
    """The primitive, a name of ``PRIMITIVES``, whose volume and moments of inertia are nearest to
    those of a mesh's hull.
    """
    hull = _measure(spec, mesh, "MESH")
    distances = {}
    for kind in PRIMITIVES:
        try:
            distances[kind] = float(np.abs(np.log(_measure(spec, mesh, kind) / hull)).sum())
        except ValueError:  # a capsule without length, where the mesh is as wide as it is long
            continue
    return min(distances, key=lambda kind: distances[kind])


def _solid(spec: mujoco.MjSpec, mesh: str) -> str:
    """The mesh, or a new one that is ``THIN`` where this one has no thickness at all."""
    import mujoco

    trial = _trial(spec, mesh, mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL)
    body = trial.worldbody.add_body(name="body", mass=1.0, inertia=[1.0, 1.0, 1.0])
    sphere = mujoco.mjtGeom.mjGEOM_SPHERE  # a mesh that collides would need a hull
    body.add_geom(type=sphere, meshname=mesh)
    model = trial.compile()
    turned = np.zeros(9)
    mujoco.mju_quat2Mat(turned, model.mesh_quat[0])
    vertices = model.mesh_pos[0] + model.mesh_vert @ turned.reshape(3, 3).T
    axes = np.linalg.svd(vertices - vertices.mean(axis=0), full_matrices=False)[2]
    thin = [axis for axis in axes if np.ptp(vertices @ axis) < THIN]
    if not thin:
        return mesh
    for axis in thin:
        vertices = np.concatenate([vertices - 0.5 * THIN * axis, vertices + 0.5 * THIN * axis])
    convex = mujoco.mjtMeshInertia.mjMESH_INERTIA_CONVEX
    spec.add_mesh(name=f"{mesh}_solid", uservert=vertices.ravel(), inertia=convex)
    return f"{mesh}_solid"


def _measure(spec: mujoco.MjSpec, mesh: str, kind: str) -> np.ndarray:
    """(4,) volume [m3] and principal moments of inertia at density 1 [m5] of a shape that MuJoCo
    fits to a mesh, or of its hull.
    """
    import mujoco

    # a primitive is fitted in the frame of what the mesh is taken for
    taken = mujoco.mjtMeshInertia.mjMESH_INERTIA_CONVEX if kind == "MESH" else None
    trial = _trial(spec, mesh, taken)
    body = trial.worldbody.add_body(name="body")
    # the density of water, and not 1: MuJoCo refuses bodies lighter than some micrograms
    body.add_geom(type=getattr(mujoco.mjtGeom, f"mjGEOM_{kind}"), meshname=mesh, density=1000.0)
    model = trial.compile()
    return np.concatenate([model.body_mass[1:], np.sort(model.body_inertia[1])]) / 1000.0


def _trial(
    spec: mujoco.MjSpec, mesh: str, inertia: mujoco.mjtMeshInertia | None = None
) -> mujoco.MjSpec:
    """A new spec with nothing but that mesh, taken for what it is there or for something else."""
    import mujoco

    trial = mujoco.MjSpec()
    trial.compiler.fitaabb = True
    trial.modelfiledir, trial.meshdir = spec.modelfiledir, spec.meshdir
    original = next(m for m in spec.meshes if (m.name or Path(m.file).stem) == mesh)
    trial.add_mesh(
        name=mesh,
        file=original.file,
        scale=original.scale,
        uservert=original.uservert,
        userface=original.userface,
        refpos=original.refpos,
        refquat=original.refquat,
        inertia=original.inertia if inertia is None else inertia,
    )
    return trial
