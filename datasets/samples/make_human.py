"""Make the bundled sample `human_walk_turn.bvh`; its points are known without reading it.

Every point follows from `human_gait` and the skeleton alone, so `keypoints` is an independent
oracle for whatever reads the file. Run `python -m lacoloco.datasets.samples.make_human` to write
the file again.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np

from lacoloco.datasets.samples import HUMAN_BVH, human_gait, skeleton

FPS = 60.0

_LEG: dict[str, tuple[str, tuple[float, float, float]]] = {
    "UpLeg": ("Hips", (9, -8, 0)),
    "Leg": ("UpLeg", (0, -44, 0)),
    "Foot": ("Leg", (0, -43, 0)),
    "ToeBase": ("Foot", (0, -7, 14)),
    "ToeBase_end": ("ToeBase", (0, 0, 6)),
}
_ARM: dict[str, tuple[str, tuple[float, float, float]]] = {
    "Shoulder": ("Spine1", (3, 20, 0)),
    "Arm": ("Shoulder", (15, 0, 0)),
    "ForeArm": ("Arm", (29, 0, 0)),
    "Hand": ("ForeArm", (25, 0, 0)),
    "Hand_end": ("Hand", (9, 0, 0)),
}


def _limb(
    side: str, parts: dict[str, tuple[str, tuple[float, float, float]]]
) -> dict[str, tuple[str, tuple[float, float, float]]]:
    sign = 1 if side == "Left" else -1
    return {
        side + name: (side + parent if parent in parts else parent, (sign * x, y, z))
        for name, (parent, (x, y, z)) in parts.items()
    }


OFFSETS: skeleton.Offsets = {
    "Hips": ("", (0, 0, 0)),
    **_limb("Left", _LEG),
    **_limb("Right", _LEG),
    "Spine": ("Hips", (0, 8, 0)),
    "Spine1": ("Spine", (0, 14, 0)),
    "Neck": ("Spine1", (0, 24, 0)),
    "Head": ("Neck", (0, 10, 1)),
    "Head_end": ("Head", (0, 18, 0)),
    **_limb("Left", _ARM),
    **_limb("Right", _ARM),
}
"""At zero rotation a person stands with arms stretched out, x to the left, y up, z forward."""

_HEIGHT = 0.98  # m, of the root
_BOB, _SWAY = 0.02, 0.015  # m
_PELVIS, _CHEST, _ROLL, _LEAN = 0.07, 0.10, 0.04, 0.05  # rad
_ARM_SWING, _ELBOW, _ABDUCTION = 0.35, (0.30, 0.25), 0.12  # rad


def keypoints(times: np.ndarray) -> np.ndarray:
    """Positions (T, 26, 3) of all nodes at `times` (T,) in s: m, world with z up, file order."""
    points, _ = _pose(np.asarray(times, dtype=np.float64))
    return np.stack([points[name] for name in OFFSETS], axis=1)


def make(path: Path = HUMAN_BVH, *, rename: dict[str, str] | None = None) -> Path:
    """Write the sample, 10 s at 60 frames per second.

    Args:
        path: file to write.
        rename: other names of joints, for the skeletons of other programs.
    """
    points, frames = _pose(np.arange(int(human_gait.DURATION * FPS) + 1) / FPS)
    text = skeleton.bvh_text(skeleton.channels(points, frames, OFFSETS), OFFSETS)
    head, motion = text.split("MOTION")
    for name, other in (rename or {}).items():
        head = head.replace(f" {name}\n", f" {other}\n")
    path.write_bytes(f"{head}MOTION{motion}".encode())
    return path


def _pose(t: np.ndarray) -> tuple[dict[str, np.ndarray], dict[str, np.ndarray]]:
    """All points (T, 3) and the axes (T, 3, 3) of all joints: left, up and forward."""
    points, frames = _trunk(t)
    for side in ("Left", "Right"):
        _leg(t, side, points, frames)
        _arm(t, side, points, frames)
    return points, frames


def _trunk(t: np.ndarray) -> tuple[dict[str, np.ndarray], dict[str, np.ndarray]]:
    """The pelvis over the path, turned towards the foot ahead, the chest against it."""
    cycle, heading = 2 * np.pi * human_gait.phase(t), human_gait.heading(t)
    over_left = 2 * np.pi * 0.31  # the middle of the left foot's single support
    left = np.stack([-np.sin(heading), np.cos(heading)], axis=-1)
    sway = _SWAY * np.cos(cycle - over_left)
    height = _HEIGHT + _BOB * np.cos(2 * (cycle - over_left))
    points = {"Hips": np.column_stack([human_gait.path(t) + sway[:, None] * left, height])}
    roll = _ROLL * np.cos(cycle - over_left)
    chest = _axes(heading + _CHEST * np.cos(cycle), _LEAN, 0.0 * t)
    frames = {
        "Hips": _axes(heading - _PELVIS * np.cos(cycle), 0.0, roll),
        "Spine": _axes(heading, 0.5 * _LEAN, 0.5 * roll),
        **dict.fromkeys(("Spine1", "LeftShoulder", "RightShoulder"), chest),
        **dict.fromkeys(("Neck", "Head"), _axes(heading, 0.0, 0.0 * t)),
    }
    for name in ("Spine", "Spine1", "Neck", "Head", "Head_end", "LeftShoulder", "RightShoulder",
                 "LeftArm", "RightArm", "LeftUpLeg", "RightUpLeg"):  # fmt: skip
        _attach(name, points, frames)
    return points, frames


def _leg(
    t: np.ndarray, side: str, points: dict[str, np.ndarray], frames: dict[str, np.ndarray]
) -> None:
    """The knee by two links between the hip and the ankle, bent to where the foot points."""
    foot = human_gait.foot(side, t)
    upper, lower = (_length(side + name) for name in ("Leg", "Foot"))
    forward = np.column_stack([np.cos(foot.yaw), np.sin(foot.yaw), 0 * t])
    points[side + "Foot"] = foot.ankle
    points[side + "Leg"] = skeleton.two_links(
        points[side + "UpLeg"], foot.ankle, upper, lower, forward
    )
    left = np.cross([0.0, 0.0, 1.0], forward)
    for name, child in (("UpLeg", "Leg"), ("Leg", "Foot")):
        up = _unit(points[side + name] - points[side + child])
        frames[side + name] = _from_up(up, left)
    frames[side + "Foot"] = _axes(foot.yaw, -foot.pitch, 0 * t)
    frames[side + "ToeBase"] = _axes(foot.yaw, -foot.toes, 0 * t)
    for name in ("ToeBase", "ToeBase_end"):
        _attach(side + name, points, frames)


def _arm(
    t: np.ndarray, side: str, points: dict[str, np.ndarray], frames: dict[str, np.ndarray]
) -> None:
    """An arm that swings against the leg of its side, its elbow bent more when it is ahead."""
    sign = 1 if side == "Left" else -1
    ahead = -sign * np.cos(2 * np.pi * human_gait.phase(t))
    swing = _ARM_SWING * ahead
    bend = _ELBOW[0] + _ELBOW[1] * (0.5 + 0.5 * ahead)
    chest = frames["Spine1"]
    for name, child, angle in (("Arm", "ForeArm", swing), ("ForeArm", "Hand", swing + bend)):
        out = sign * np.sin(_ABDUCTION) * np.ones_like(t)
        bone = np.stack([out, -np.cos(angle), np.sin(angle)], axis=-1)
        bone[:, 1:] *= np.cos(_ABDUCTION)
        along = sign * np.einsum("tij,tj->ti", chest, bone)
        aside = sign * chest[..., 0] - (sign * chest[..., 0] * along).sum(1, keepdims=True) * along
        up = _unit(aside)
        frames[side + name] = np.stack([along, up, np.cross(along, up)], axis=-1)
        _attach(side + child, points, frames)
    frames[side + "Hand"] = frames[side + "ForeArm"]
    _attach(side + "Hand_end", points, frames)


def _attach(name: str, points: dict[str, np.ndarray], frames: dict[str, np.ndarray]) -> None:
    parent, offset = OFFSETS[name]
    points[name] = points[parent] + frames[parent] @ (np.array(offset) / 100)


def _length(name: str) -> float:
    return float(np.linalg.norm(OFFSETS[name][1])) / 100


def _unit(vectors: np.ndarray) -> np.ndarray:
    return vectors / np.linalg.norm(vectors, axis=1, keepdims=True)


def _from_up(up: np.ndarray, left: np.ndarray) -> np.ndarray:
    """Axes (T, 3, 3) with this up and as near to this left as they can be."""
    left = _unit(left - (left * up).sum(1, keepdims=True) * up)
    return np.stack([left, up, np.cross(left, up)], axis=-1)


def _axes(yaw: np.ndarray, pitch: np.ndarray | float, roll: np.ndarray | float) -> np.ndarray:
    """Left, up and forward (T, 3, 3) from yaw, pitch (nose down) and roll (left side up)."""
    yaw, pitch, roll = np.broadcast_arrays(yaw, pitch, roll)
    cy, sy, cp, sp = np.cos(yaw), np.sin(yaw), np.cos(pitch), np.sin(pitch)
    cr, sr = np.cos(roll), np.sin(roll)
    forward = np.stack([cy * cp, sy * cp, -sp], axis=-1)
    left = np.stack([cy * sp * sr - sy * cr, sy * sp * sr + cy * cr, cp * sr], axis=-1)
    return np.stack([left, np.cross(forward, left), forward], axis=-1)


if __name__ == "__main__":
    make(Path(sys.argv[1]) if len(sys.argv) > 1 else HUMAN_BVH)
