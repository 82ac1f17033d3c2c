"""Make the bundled sample `dog_walk_trot_turn.bvh`; its points are known without reading it.

Every point follows from `gait` and the skeleton alone (trunk along the path, paws planted where the
gait says, two-link legs between them), so `keypoints` is an independent oracle for whatever reads
the file. Run `python -m lacoloco.datasets.samples.make_dog` to write the file again.
"""

from __future__ import annotations

import sys
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from lacoloco.datasets.samples import DOG_BVH, gait, skeleton

FPS = 60.0

_GAITS = (gait.WALK, gait.TROT)
_PAD = 0.03  # m: the end of a limb is the middle of the paw, above the ground
_FORWARD, _LEFT, _UP = np.eye(3)
_SCAPULA = np.array([0.55, 0.62, 0.5])  # forward, down, outward: from withers to shoulder joint
_SCAPULA_SWING = 0.6  # rad per metre that the paw is ahead of the withers


@dataclass(frozen=True)
class _Limb:
    """What tells fore from hind legs; lengths in m, angles in rad."""

    ahead: float
    """Of the hip or withers: where the paw stands in mid-stance."""
    aside: float
    """From the middle of the body."""
    lift: tuple[float, float]
    """Height of the paw in swing, walk and trot."""
    lean: float
    """Angle of the foot's last bone from vertical in stance, positive with its top forward."""
    flex: float
    """What folding adds to it in swing."""


_FORE = _Limb(0.03, 0.05, (0.06, 0.09), -0.15, 1.2)
_HIND = _Limb(-0.01, 0.05, (0.04, 0.055), -0.05, 0.8)


def keypoints(times: np.ndarray) -> np.ndarray:
    """Positions (T, 27, 3) of all nodes at `times` (T,) in s: m, world with z up, file order."""
    points, _ = _pose(np.asarray(times, dtype=np.float64))
    return np.stack([points[name] for name in skeleton.OFFSETS], axis=1)


def stance(times: np.ndarray) -> dict[str, np.ndarray]:
    """Which paws stand on the ground: bool (T,) by name of the limb's end."""
    standing = {}
    for end in ("LeftHand_end", "RightHand_end", "LeftFoot_end", "RightFoot_end"):
        down, up = gait.footfalls(_leg(end))
        index = np.searchsorted(down, times, side="right") - 1
        standing[end] = times < up[index]
    return standing


def make(path: Path = DOG_BVH, *, newline: str = "\n") -> Path:
    """Write the sample, 12 s at 60 frames per second.

    Args:
        path: file to write.
        newline: line end; carriage return and line feed make the variant of some programs.
    """
    times = np.arange(int(gait.DURATION * FPS) + 1) / FPS
    points, trunk = _pose(times)
    rows = skeleton.channels(points, skeleton.joint_frames(points, trunk))
    path.write_bytes(skeleton.bvh_text(rows, newline=newline).encode())
    return path


def _pose(t: np.ndarray) -> tuple[dict[str, np.ndarray], dict[str, np.ndarray]]:
    """All points (T, 3) and the axes (T, 3, 3) of the trunk's joints."""
    points, trunk = _trunk(t)
    _head_and_tail(t, points, trunk)
    for side, sign in (("Left", 1), ("Right", -1)):
        _fore_leg(t, side, sign, points, trunk)
        _hind_leg(t, side, points, trunk)
    return points, trunk


def _trunk(t: np.ndarray) -> tuple[dict[str, np.ndarray], dict[str, np.ndarray]]:
    """Hips over the path, a back that bends into the turn, and where the limbs are attached."""
    cycle = 2 * np.pi * gait.phase(t)
    walk, trot = 1 - gait.trot_share(t), gait.trot_share(t)
    heading, bend = gait.heading(t), gait.curvature(t)
    # Highest over the hind legs in mid-stance when walking, lowest over a diagonal when trotting.
    over_hind, over_pair = (np.pi * g.duty + 2 * np.pi * g.lags["LH"] for g in _GAITS)
    bob = 0.005 * walk * np.cos(2 * (cycle - over_hind))
    bob -= 0.012 * trot * np.cos(2 * (cycle - over_pair))
    sway = 0.008 * walk * np.cos(cycle - over_hind)
    side = np.stack([-np.sin(heading), np.cos(heading)], axis=-1)
    hips = np.column_stack(
        [gait.path(t) + sway[:, None] * side, gait.between(0.455, 0.440, t) + bob]
    )
    yaw = heading - np.radians(2.5) * np.cos(cycle)
    roll = -np.radians(2.0) * np.cos(cycle - 2 * np.pi * 0.8)
    pitch = np.radians(1.0) * np.cos(2 * cycle)
    body = _axes(yaw, pitch, roll)
    trunk = {
        "Hips": np.stack([-body[..., 0], body[..., 2], body[..., 1]], axis=-1),
        "Spine": _spine(_axes(heading + 0.10 * bend, 0.10 + 0.5 * pitch, 0.3 * roll)),
        "Spine1": _spine(_axes(heading + 0.30 * bend, -0.02 - 0.5 * pitch, -0.3 * roll)),
    }
    points = {"Hips": hips}
    for name in ("Spine", "Spine1", "Neck", "LeftShoulder", "RightShoulder", "LeftUpLeg",
                 "RightUpLeg", "Tail"):  # fmt: skip
        parent = skeleton.OFFSETS[name][0]
        points[name] = points[parent] + trunk[parent] @ skeleton.offset(name)
    return points, trunk


def _head_and_tail(
    t: np.ndarray, points: dict[str, np.ndarray], trunk: dict[str, np.ndarray]
) -> None:
    cycle = 2 * np.pi * gait.phase(t)
    gaze = gait.heading(t) + 0.5 * gait.curvature(t)
    neck = _axes(gaze, -0.50 - 0.05 * np.cos(2 * cycle), 0 * t)[..., 0]
    head = _axes(gaze, 0.15 + 0.03 * np.cos(2 * cycle), 0 * t)[..., 0]
    wag = gait.heading(t) + np.pi + 0.2 * np.sin(cycle)
    tail = _axes(wag, 0.35 + 0 * t, 0 * t)[..., 0]
    tip = _axes(wag + 0.1 * np.sin(cycle - 1), 0.15 + 0 * t, 0 * t)[..., 0]
    for name, direction in (
        ("Head", neck), ("Head_end", head), ("Tail1", tail), ("Tail1_end", tip)
    ):  # fmt: skip
        points[name] = points[skeleton.OFFSETS[name][0]] + skeleton.length(name) * direction


def _fore_leg(
    t: np.ndarray, side: str, sign: int, points: dict[str, np.ndarray],
    trunk: dict[str, np.ndarray],
) -> None:  # fmt: skip
    """Scapula, then elbow by two links between the shoulder joint and the planted paw."""
    paw, wrist = _paw(t, f"{side}Hand", _FORE)
    axes, withers = trunk["Spine1"], points[f"{side}Shoulder"]
    ahead = ((paw - withers) * axes[..., 0]).sum(1) - _FORE.ahead
    swing = _SCAPULA_SWING * ahead
    down = np.array([_SCAPULA[0], _SCAPULA[1]])
    scapula = np.stack(
        [
            np.cos(swing) * down[0] + np.sin(swing) * down[1],
            np.cos(swing) * down[1] - np.sin(swing) * down[0],
            np.full_like(swing, sign * _SCAPULA[2]),
        ],
        axis=-1,
    ) / np.linalg.norm(_SCAPULA)
    arm = withers + skeleton.length(f"{side}Arm") * np.einsum("tij,tj->ti", axes, scapula)
    lengths = skeleton.length(f"{side}ForeArm"), skeleton.length(f"{side}Hand")
    elbow = skeleton.two_links(arm, wrist, *lengths, -axes[..., 0])
    points |= {f"{side}Arm": arm, f"{side}ForeArm": elbow}
    points |= {f"{side}Hand": wrist, f"{side}Hand_end": paw}


def _hind_leg(
    t: np.ndarray, side: str, points: dict[str, np.ndarray], trunk: dict[str, np.ndarray]
) -> None:
    """Knee by two links between the hip joint and the hock above the planted paw."""
    paw, hock = _paw(t, f"{side}Foot", _HIND)
    lengths = skeleton.length(f"{side}Leg"), skeleton.length(f"{side}Foot")
    knee = skeleton.two_links(points[f"{side}UpLeg"], hock, *lengths, -trunk["Hips"][..., 0])
    points |= {f"{side}Leg": knee, f"{side}Foot": hock, f"{side}Foot_end": paw}


def _paw(t: np.ndarray, joint: str, limb: _Limb) -> tuple[np.ndarray, np.ndarray]:
    """End of a limb and the joint above it, (T, 3) each: fixed in stance, an arc in swing."""
    down, up = gait.footfalls(_leg(joint))
    prints, directions = _footprints(0.5 * (down + up), joint, limb)
    index = np.searchsorted(down, t, side="right") - 1
    swing = (t - up[index]) / (down[index + 1] - up[index])
    share = gait.stride(swing)
    place = prints[index] + share[:, None] * (prints[index + 1] - prints[index])
    direction = directions[index] + share * (directions[index + 1] - directions[index])
    height = _PAD + gait.between(*limb.lift, t) * gait.bump(swing)
    paw = np.column_stack([place, height])
    # The heel comes up in the last quarter of stance; the foot is folded most early in swing.
    heel_off = down[index] + 0.75 * (up[index] - down[index])
    fold = gait.bump((t - heel_off) / (down[index + 1] - heel_off))
    tilt = limb.lean + limb.flex * fold
    bone = np.stack(
        [np.sin(tilt) * np.cos(direction), np.sin(tilt) * np.sin(direction), np.cos(tilt)],
        axis=-1,
    )
    return paw, paw + skeleton.length(f"{joint}_end") * bone


def _footprints(t: np.ndarray, joint: str, limb: _Limb) -> tuple[np.ndarray, np.ndarray]:
    """Where (n, 2) and in which direction (n,) a paw stands whose mid-stance is at t (n,)."""
    points, trunk = _trunk(t)
    fore = joint.endswith("Hand")
    axes = trunk["Spine1"] if fore else trunk["Hips"]
    forward = axes[..., 0] if fore else -axes[..., 0]
    direction = np.arctan2(forward[:, 1], forward[:, 0])
    ahead = np.stack([np.cos(direction), np.sin(direction)], axis=-1)
    left = np.stack([-np.sin(direction), np.cos(direction)], axis=-1)
    pair = [points[f"{side}{'Shoulder' if fore else 'UpLeg'}"] for side in ("Left", "Right")]
    aside = limb.aside if joint.startswith("Left") else -limb.aside
    return 0.5 * (pair[0] + pair[1])[:, :2] + limb.ahead * ahead + aside * left, direction


def _axes(yaw: np.ndarray, pitch: np.ndarray, roll: np.ndarray) -> np.ndarray:
    """Forward, left and up (columns, (T, 3, 3)) of Rz(yaw) Ry(pitch) Rx(roll)."""
    cy, sy, cp, sp = np.cos(yaw), np.sin(yaw), np.cos(pitch), np.sin(pitch)
    cr, sr = np.cos(roll), np.sin(roll)
    forward = np.stack([cy * cp, sy * cp, -sp], axis=-1)
    left = np.stack([cy * sp * sr - sy * cr, sy * sp * sr + cy * cr, cp * sr], axis=-1)
    return np.stack([forward, left, np.cross(forward, left)], axis=-1)


def _spine(axes: np.ndarray) -> np.ndarray:
    """Axes of a spine joint, forward, down and left, from forward, left and up."""
    return np.stack([axes[..., 0], -axes[..., 2], axes[..., 1]], axis=-1)


def _leg(joint: str) -> str:
    return joint[0] + ("F" if "Hand" in joint else "H")


if __name__ == "__main__":
    make(Path(sys.argv[1]) if len(sys.argv) > 1 else DOG_BVH)
