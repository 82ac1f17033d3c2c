"""Meshcat commands that build the scene: the robot's geoms as its MJCF has them, and the ground.

Commands are kept as dictionaries, as meshcat's viewer takes them; no server is involved.
"""

from __future__ import annotations

from collections.abc import Sequence
from io import BytesIO
from typing import Any

import meshcat.geometry as g
import mujoco
import numpy as np
from meshcat.commands import SetObject, SetTransform
from meshcat.path import Path as ScenePath
from PIL import Image

from lacoloco.datasets import rotations
from lacoloco.robots.spec import RobotSpec

Command = dict[str, Any]

WORLD = "world"
"""Node of everything that has a place; the player moves it past the camera, which cannot follow:
meshcat's controls always look at the origin."""
GROUND_SIZE = 60.0
"""m."""
CAMERA = np.array([1.26, 0.58, 1.45])
"""Where the camera stands, in sizes of the robot; meshcat turns its camera's frame so that y is
up there: (x, z, -y) of the world.
"""
LIGHT = np.array([1.0, 1.5, 5.8])
"""Where the light that casts shadows hangs, in sizes of the robot: above its head, and so far
away that all of a robot of any size is in the cone."""
_UP = np.array([0.0, 0.0, 1.0])


def robot_commands(spec: RobotSpec) -> list[Command]:
    """Bodies nested as in the model, so that joints animate by rotation alone."""
    model = spec.model()
    commands = []
    for body in range(2, model.nbody):
        matrix = pose_matrix(model.body_pos[body], model.body_quat[body])
        commands.append(_transform(body_path(model, body), matrix))
    for geom in range(model.ngeom):
        commands += _geom_commands(model, geom)
    return commands


def body_path(model: mujoco.MjModel, body: int) -> str:
    """Path of a body in the scene tree; the base is `world/robot`."""
    names = []
    while model.body_parentid[body] != 0:
        names.append(model.body(body).name)
        body = model.body_parentid[body]
    return "/".join([WORLD, "robot", *reversed(names)])


def geom_paths(model: mujoco.MjModel, body: str) -> list[str]:
    """Scene paths of the geoms of one body."""
    owner = model.body(body).id
    geoms = np.flatnonzero(model.geom_bodyid == owner)
    return [f"{body_path(model, owner)}/geom{geom}" for geom in geoms]


def world_commands(size: float) -> list[Command]:
    """Ground at z = 0 in squares of half a metre, a sky, and where the camera stands.

    Args:
        size: Of the robot, m; see `Extent`.
    """
    ground = g.Box([GROUND_SIZE, GROUND_SIZE, 0.02])
    # Phong is lit per pixel; Lambert would be lit at the distant corners only, and take no shadow.
    material = g.MeshPhongMaterial(map=_checkers(GROUND_SIZE), specular=0)
    return [
        _object(f"{WORLD}/ground", ground, material),
        _transform(f"{WORLD}/ground", pose_matrix([0, 0, -0.01])),
        _property("Background", "top_color", [0.80, 0.88, 0.96]),
        _property("Background", "bottom_color", [0.97, 0.98, 0.99]),
        _property("Axes", "visible", False),
        _property("Lights/PointLightNegativeX", "visible", False),
        _property("Lights/PointLightPositiveX", "visible", False),
        _property("Lights/FillLight/<object>", "position", [-2.0, -3.0, 10.0]),
        _property("Lights/SpotLight", "visible", True),  # for the shadows
        _property("Lights/SpotLight/<object>", "castShadow", True),
        _property("Lights/SpotLight/<object>", "position", (LIGHT * size).tolist()),
        _property("Lights/SpotLight/<object>", "intensity", 0.5),
        _property("Lights/SpotLight/<object>", "penumbra", 1.0),
        _property("Cameras/default/rotated/<object>", "position", (CAMERA * size).tolist()),
    ]


def _checkers(size: float) -> g.ImageTexture:
    """Squares, four to the square metre: a moving ground needs a pattern to be seen to move."""
    squares = np.kron([[150, 172], [172, 150]], np.ones((128, 128))).astype(np.uint8)
    file = BytesIO()
    Image.fromarray(squares).save(file, "PNG")
    repeat = 1000  # three.js: RepeatWrapping
    return g.ImageTexture(g.PngImage(file.getvalue()), wrap=[repeat, repeat], repeat=[size, size])


def marker_command(path: str, radius: float, color: int, opacity: float = 1.0) -> Command:
    """A ball."""
    material = g.MeshLambertMaterial(color=color, opacity=opacity, transparent=opacity < 1)
    return _object(path, g.Sphere(radius), material)


def line_command(path: str, points: np.ndarray, color: int) -> Command:
    """A line through points (T, 3), m."""
    geometry = g.PointsGeometry(np.asarray(points, dtype=np.float32).T)
    line = g.Line(geometry, g.LineBasicMaterial(color=color))
    return SetObject(line, None, _path(path)).lower()


def rod_command(path: str, radius: float, color: int) -> Command:
    """A rod of length 1 m along y around the origin; the player makes others of it, and places
    them: lines are one pixel thin in browsers.
    """
    return _object(path, g.Cylinder(1.0, radius), g.MeshLambertMaterial(color=color))


def points_command(path: str, count: int, color: int, size: float) -> Command:
    """`count` points of this size, m, all at the origin until they are set."""
    shade = np.array([color >> 16 & 255, color >> 8 & 255, color & 255], dtype=np.float32) / 255
    place = np.zeros((3, count), dtype=np.float32)
    geometry = g.PointsGeometry(place, np.tile(shade[:, None], count))  # the material has no colour
    points = g.Points(geometry, g.PointsMaterial(size=size))
    return SetObject(points, None, _path(path)).lower()


def pose_matrix(position: Sequence[float], quat: np.ndarray | None = None) -> np.ndarray:
    """Homogeneous matrix (4, 4) of a position, m, and a unit quaternion wxyz."""
    matrix = np.eye(4)
    matrix[:3, 3] = position
    if quat is not None:
        matrix[:3, :3] = rotations.to_matrix(np.asarray(quat, dtype=np.float64))
    return matrix


def _geom_commands(model: mujoco.MjModel, geom: int) -> list[Command]:
    path = f"{body_path(model, model.geom_bodyid[geom])}/geom{geom}"
    red, green, blue, alpha = model.geom_rgba[geom]
    color = int(red * 255) << 16 | int(green * 255) << 8 | int(blue * 255)
    material = g.MeshPhongMaterial(color=color, opacity=float(alpha), transparent=bool(alpha < 1))
    pose = pose_matrix(model.geom_pos[geom], model.geom_quat[geom])
    commands = [_transform(path, pose)]
    for index, (shape, offset) in enumerate(_shapes(model.geom_type[geom], model.geom_size[geom])):
        part = f"{path}/part{index}"
        commands += [_object(part, shape, material), _transform(part, offset)]
    return commands


def _shapes(kind: int, size: np.ndarray) -> list[tuple[g.Geometry, np.ndarray]]:
    """Meshcat shapes that make up a MuJoCo geom, each with its place in the geom's frame."""
    sizes = [float(value) for value in size]
    lying = np.array(
        [[1, 0, 0, 0], [0, 0, -1, 0], [0, 1, 0, 0], [0, 0, 0, 1.0]]
    )  # y axis -> z axis
    if kind == mujoco.mjtGeom.mjGEOM_BOX:
        return [(g.Box([2 * value for value in sizes]), np.eye(4))]
    if kind == mujoco.mjtGeom.mjGEOM_SPHERE:
        return [(g.Sphere(sizes[0]), np.eye(4))]
    if kind == mujoco.mjtGeom.mjGEOM_ELLIPSOID:
        return [(g.Sphere(1.0), np.diag([*sizes, 1.0]))]
    if kind == mujoco.mjtGeom.mjGEOM_CYLINDER:
        return [(g.Cylinder(2 * sizes[1], sizes[0]), lying)]
    if kind == mujoco.mjtGeom.mjGEOM_CAPSULE:
        ends = [
            (g.Sphere(sizes[0]), pose_matrix((sign * sizes[1] * _UP).tolist())) for sign in (-1, 1)
        ]
        return [(g.Cylinder(2 * sizes[1], sizes[0]), lying), *ends]
    return []  # meshes and planes have no place in a robot of primitives


def _path(path: str) -> ScenePath:
    return ScenePath(tuple(path.split("/")))


def _object(path: str, geometry: g.Geometry, material: g.Material) -> Command:
    return SetObject(geometry, material, _path(path)).lower()


def _transform(path: str, matrix: np.ndarray) -> Command:
    return SetTransform(matrix, _path(path)).lower()


def _property(path: str, key: str, value: Any) -> Command:
    # Not meshcat's SetProperty, which writes `castShadow` in lower case.
    return {"type": "set_property", "path": f"/{path}", "property": key, "value": value}
