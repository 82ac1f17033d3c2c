"""The sample dog's skeleton, and how points on it become the angles of a BVH file.

Joint names, channel order, units (cm, degrees, y up) and layout are those of the common dog
recordings, so that what reads one reads the other; the bone lengths are round ones of our own.
At zero rotation every bone points along its parent's x axis.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

Offsets = Mapping[str, tuple[str, tuple[float, float, float]]]
"""Node -> parent and offset in the parent's axes, cm; in file order, parents first."""

OFFSETS: Offsets = {
    "Hips": ("", (-31.5, 12.25, -420.0)),  # left over from a capture set-up; readers ignore it
    "Spine": ("Hips", (0, 0, 0)),
    "Spine1": ("Spine", (20, 0, 0)),
    "Neck": ("Spine1", (22, 0.5, 0)),
    "Head": ("Neck", (14, 0, 0)),
    "Head_end": ("Head", (16, 0, 0)),
    "LeftShoulder": ("Spine1", (20, 3.5, 4.5)),
    "LeftArm": ("LeftShoulder", (8, 0, 0)),
    "LeftForeArm": ("LeftArm", (15.5, 0, 0)),
    "LeftHand": ("LeftForeArm", (18, 0, 0)),
    "LeftHand_end": ("LeftHand", (7, 0, 0)),
    "RightShoulder": ("Spine1", (20, 3.5, -4.5)),
    "RightArm": ("RightShoulder", (8, 0, 0)),
    "RightForeArm": ("RightArm", (15.5, 0, 0)),
    "RightHand": ("RightForeArm", (18, 0, 0)),
    "RightHand_end": ("RightHand", (7, 0, 0)),
    "LeftUpLeg": ("Hips", (6, -7.5, 5)),
    "LeftLeg": ("LeftUpLeg", (16.5, 0, 0)),
    "LeftFoot": ("LeftLeg", (18.5, 0, 0)),
    "LeftFoot_end": ("LeftFoot", (0, -11, 0)),
    "RightUpLeg": ("Hips", (6, -7.5, -5)),
    "RightLeg": ("RightUpLeg", (16.5, 0, 0)),
    "RightFoot": ("RightLeg", (18.5, 0, 0)),
    "RightFoot_end": ("RightFoot", (0, -11, 0)),
    "Tail": ("Hips", (7, -0.5, 0)),
    "Tail1": ("Tail", (12, 0, 0)),
    "Tail1_end": ("Tail1", (12, 0, 0)),
}
"""Those of the dog."""

TO_BVH = np.array([[-1.0, 0, 0], [0, 0, 1.0], [0, 1.0, 0]])
"""World vector (z up) -> file vector (y up), a proper rotation and its own inverse."""

_FEET = ("LeftFoot", "RightFoot")  # their bone is along -y, as in the recordings


def offset(name: str) -> np.ndarray:
    """Offset (3,) of a node in its parent's axes, m."""
    return np.array(OFFSETS[name][1]) / 100


def length(name: str) -> float:
    """Length of the bone that ends in a node, m."""
    return float(np.linalg.norm(offset(name)))


def frame_along(direction: np.ndarray, left: np.ndarray) -> np.ndarray:
    """Axes (T, 3, 3) as columns: x along `direction` (T, 3), z as near to `left` as it can be."""
    x = direction / np.linalg.norm(direction, axis=1, keepdims=True)
    z = left - (left * x).sum(1, keepdims=True) * x
    z /= np.linalg.norm(z, axis=1, keepdims=True)
    return np.stack([x, np.cross(z, x), z], axis=-1)


def joint_frames(
    points: dict[str, np.ndarray], trunk: dict[str, np.ndarray]
) -> dict[str, np.ndarray]:
    """World axes (T, 3, 3) of all joints from the points (T, 3) and the axes of the trunk.

    Args:
        points: by node, world, any unit.
        trunk: axes of Hips, Spine and Spine1, which carry several bones or none.
    """
    frames = dict(trunk)
    for name, (parent, _) in OFFSETS.items():
        if parent and parent not in frames:
            left = trunk["Hips" if "Leg" in parent or "Foot" in parent else "Spine1"][..., 2]
            frame = frame_along(points[name] - points[parent], left)
            if parent in _FEET:  # turn about z, so that -y instead of x is along the bone
                frame = np.stack([frame[..., 1], -frame[..., 0], frame[..., 2]], axis=-1)
            frames[parent] = frame
    return frames


def two_links(
    start: np.ndarray, end: np.ndarray, first: float, second: float, towards: np.ndarray
) -> np.ndarray:
    """The joint (T, 3) between two links of given lengths, bent to the side of `towards`."""
    line = end - start
    distance = np.linalg.norm(line, axis=1, keepdims=True)
    if distance.max() > 0.99 * (first + second):
        worst = int(distance.argmax())
        raise ValueError(f"a leg would have to be straight in frame {worst}")
    line /= distance
    along = (distance**2 + first**2 - second**2) / (2 * distance)
    across = towards - (towards * line).sum(1, keepdims=True) * line
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    return start + along * line + np.sqrt(first**2 - along**2) * across


def channels(
    points: dict[str, np.ndarray], frames: dict[str, np.ndarray], offsets: Offsets = OFFSETS
) -> np.ndarray:
    """Rows (T, 3 + 3 J) of a BVH file with J joints: root position in cm, then z, x, y angles of
    all joints in deg.

    Args:
        points: the root's, named "Hips", world, m.
        frames: world axes (T, 3, 3) of all joints.
        offsets: the skeleton.
    """
    columns = [100 * points["Hips"] @ TO_BVH.T]
    for name, (parent, _) in offsets.items():
        if name.endswith("_end"):
            continue
        base = np.swapaxes(frames[parent], -1, -2) if parent else TO_BVH
        columns.append(np.degrees(np.unwrap(_euler_zxy(base @ frames[name]), axis=0)))
    return np.concatenate(columns, axis=1)


def _euler_zxy(matrix: np.ndarray) -> np.ndarray:
    """Angles (T, 3) in rad of R = Rz Rx Ry."""
    z = np.arctan2(-matrix[:, 0, 1], matrix[:, 1, 1])
    x = np.arcsin(np.clip(matrix[:, 2, 1], -1, 1))
    y = np.arctan2(-matrix[:, 2, 0], matrix[:, 2, 2])
    return np.stack([z, x, y], axis=-1)


def bvh_text(rows: np.ndarray, offsets: Offsets = OFFSETS, *, newline: str = "\n") -> str:
    """A BVH file, laid out as the recordings are: two spaces per level, a tab after `Frames:`."""
    lines = ["HIERARCHY", *_node_lines("Hips", 0, offsets), "MOTION", f"Frames:\t{len(rows)}"]
    lines.append("Frame Time:\t0.0166667")
    # Five decimals of a degree keep every point within 1e-6 m.
    lines += [" ".join(f"{value:.5f}" for value in row) for row in rows]
    return newline.join([*lines, ""])


def _node_lines(name: str, depth: int, offsets: Offsets) -> list[str]:
    pad = "  " * depth
    parent, numbers = offsets[name]
    values = " ".join(f"{value:g}" for value in numbers)
    if name.endswith("_end"):
        return [f"{pad}End Site", pad + "{", f"{pad}  OFFSET {values}", pad + "}"]
    position = "" if parent else "Xposition Yposition Zposition "
    count = 3 if parent else 6
    lines = [f"{pad}{'JOINT' if parent else 'ROOT'} {name}", pad + "{", f"{pad}  OFFSET {values}"]
    lines.append(f"{pad}  CHANNELS {count} {position}Zrotation Xrotation Yrotation")
    for child, (its_parent, _) in offsets.items():
        if its_parent == name:
            lines += _node_lines(child, depth + 1, offsets)
    return [*lines, pad + "}"]
