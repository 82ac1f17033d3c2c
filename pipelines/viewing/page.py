"""One self-contained HTML page per playback: meshcat's viewer, the scene, and a small player.

Meshcat's own static page has no text and no notion of frames, so two scripts add both: pane.js
seeks meshcat's animation and writes down what holds at that moment, player.js has the controls.
"""

from __future__ import annotations

import base64
import json
from collections.abc import Mapping, Sequence
from html import escape
from pathlib import Path
from typing import Any

import meshcat
import numpy as np
import umsgpack

from lacoloco.datasets import rotations
from lacoloco.pipelines.retargeting.filters import smooth
from lacoloco.pipelines.retargeting.forward_kinematics import BodyPositions
from lacoloco.pipelines.viewing import scene
from lacoloco.pipelines.viewing.extent import standing_extent
from lacoloco.pipelines.viewing.recording import Recording
from lacoloco.robots.spec import RobotSpec

VIEWER = Path(meshcat.__file__).parent / "viewer" / "dist" / "main.min.js"
FLOAT32 = 0x17
"""Extension type of meshcat's messages for an array of single-precision numbers."""
TRACE, TARGET, BONES = 0x2A6FDB, 0xD7263D, 0x7A5C3E
"""Colours of the end effector's trace, the target and the animal."""
BALL, ROD, ASIDE = 0.065, 0.018, 1.6
"""In heights of the base of the standing robot: radius of the target and size of the animal's
joints; radius of the animal's bones; how far to the left of the robot the animal walks when not
over it.
"""
LOOKED_AT = 0.44
"""Height of the point the camera looks at, in heights of the robot."""


def build_page(spec: RobotSpec, recordings: Sequence[Recording], title: str) -> str:
    """Make the page.

    Args:
        spec: The robot of all recordings.
        recordings: At least one; the page lets one choose between them.
        title: Of the page.

    Returns:
        HTML that needs no other file and no network.
    """
    height = spec.default_height()
    extent = standing_extent(spec)
    commands = [*scene.world_commands(extent.size), *scene.robot_commands(spec)]
    end_effectors = EndEffector(spec)
    played = []
    for index, recording in enumerate(recordings):
        reached = end_effectors.positions(recording)
        commands += _extras(index, recording, reached, height)
        animation = _packed(_animation(spec, recording))
        played.append(_player_data(recording, reached, ASIDE * height) | {"animation": animation})
    data = {
        "eyeHeight": LOOKED_AT * extent.top,
        "feet": [
            {"name": foot.removesuffix("_FOOT"), "geoms": scene.geom_paths(spec.model(), foot)}
            for foot in spec.feet
        ],
        "scene": [_packed(command) for command in commands],
        "recordings": played,
    }
    here = Path(__file__).parent
    page = (here / "page.html").read_text(encoding="utf-8")
    parts = {
        "{{title}}": escape(title),
        "{{pane}}": (here / "pane.js").read_text(encoding="utf-8"),
        "{{player}}": (here / "player.js").read_text(encoding="utf-8"),
        "{{data}}": json.dumps(data, separators=(",", ":")).replace("</", "<\\/"),
        "{{viewer}}": VIEWER.read_text(encoding="utf-8"),
    }
    for mark, text in parts.items():
        page = page.replace(mark, text)
    return page


class EndEffector:
    """Where the end effector of a robot is."""

    def __init__(self, spec: RobotSpec) -> None:
        """Build its kinematics."""
        self._positions = BodyPositions(
            spec.pinocchio_model(), [spec.end_effector.body], [spec.end_effector.offset]
        )

    def positions(self, recording: Recording) -> np.ndarray:
        """World positions (T, 3), m."""
        poses = (recording.root_pos, recording.root_quat, recording.joint_pos)
        return self._positions(*poses)[:, 0]


def _extras(
    index: int, recording: Recording, reached: np.ndarray, height: float
) -> list[scene.Command]:
    """Trace, target and animal of one recording, below a node that is shown with it; sizes follow
    from the height of the base in standing, m.
    """
    root, ball = f"{scene.WORLD}/recording{index}", BALL * height
    commands = [scene.line_command(f"{root}/trace", reached, TRACE)]
    if recording.target is not None:
        commands.append(scene.marker_command(f"{root}/target", ball, TARGET))
    if recording.skeleton is not None:
        count = recording.skeleton.shape[1]
        commands.append(scene.rod_command(f"{root}/bone", ROD * height, BONES))
        commands.append(scene.points_command(f"{root}/joints", count, BONES, ball))
    return commands


def _animation(spec: RobotSpec, recording: Recording) -> scene.Command:
    """Meshcat's animation: the base moves, every joint turns its body, the target follows."""
    model = spec.model()
    tracks = {
        f"{scene.WORLD}/robot": {"position": recording.root_pos, "quaternion": recording.root_quat}
    }
    for joint in range(1, model.njnt):
        body, column = model.jnt_bodyid[joint], model.jnt_qposadr[joint] - 7
        turn = rotations.exp_map(recording.joint_pos[:, column, None] * model.jnt_axis[joint])
        quat = rotations.multiply(model.body_quat[body][None], turn)
        tracks[scene.body_path(model, body)] = {"quaternion": quat}
    return {
        "type": "set_animation",
        "path": "",
        "animations": [
            {"path": f"/{path}", "clip": _clip(recording.fps, series)}
            for path, series in tracks.items()
        ],
        "options": {"play": True, "repetitions": float("inf")},
    }


def _clip(fps: float, series: Mapping[str, np.ndarray]) -> dict[str, Any]:
    """Animation of one node. Typed arrays are a tenth of meshcat's own list of keys."""
    tracks = []
    for name, rows in series.items():
        values = np.roll(rows, -1, axis=1) if name == "quaternion" else rows  # wxyz -> xyzw
        kind = "quaternion" if name == "quaternion" else "vector"
        times = np.arange(len(rows), dtype=np.float32)  # in frames; three.js divides by fps
        tracks.append(
            {"name": f".{name}", "type": kind, "times": _floats(times), "values": _floats(values)}
        )
    return {"fps": fps, "name": "default", "tracks": tracks}


def _player_data(recording: Recording, reached: np.ndarray, aside: float) -> dict[str, Any]:
    """What the player writes down or colours at each frame; the animal may walk so far aside, m."""
    travel = smooth(recording.root_pos[:, :2], 0.3 * recording.fps)
    speed = np.linalg.norm(np.gradient(recording.root_pos[:, :2], axis=0), axis=1) * recording.fps
    data: dict[str, Any] = {
        "name": recording.name,
        "note": recording.note,
        "fps": recording.fps,
        "frames": recording.frames,
        "camera": _rounded(travel),
        "speed": _rounded(smooth(speed, 0.1 * recording.fps)),
        "height": _rounded(recording.root_pos[:, 2]),
    }
    if recording.target is not None:
        distance = np.linalg.norm(reached - recording.target, axis=1)
        data |= {"target": _rounded(recording.target), "distance": _rounded(distance)}
    if recording.latent is not None:
        data["latent"] = _rounded(recording.latent)
    if recording.contacts is not None:
        data["contacts"] = recording.contacts.astype(int).tolist()
    if recording.skeleton is not None:
        points = np.ascontiguousarray(recording.skeleton, dtype="<f4").tobytes()
        left = rotations.rotate(recording.root_quat, np.array([0.0, 1.0, 0.0]))[:, :2]
        left = smooth(left, 0.3 * recording.fps)
        data |= {"skeleton": base64.b64encode(points).decode(), "bones": recording.bones}
        data["aside"] = _rounded(aside * left / np.linalg.norm(left, axis=1, keepdims=True))
    return data


def _floats(array: np.ndarray) -> umsgpack.Ext:
    return umsgpack.Ext(FLOAT32, np.ascontiguousarray(array, dtype="<f4").tobytes())


def _packed(command: scene.Command) -> str:
    return base64.b64encode(umsgpack.packb(command)).decode()


def _rounded(array: np.ndarray) -> list[Any]:
    return np.round(array.astype(np.float64), 3).tolist()
