"""The robot.toml of an imported robot, and what has to be asked."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from string import Template
from typing import TYPE_CHECKING

import numpy as np

from lacoloco.robots.geometry import standing_height
from lacoloco.robots.importing.gains import Gains, clip_gains, rounded
from lacoloco.robots.importing.kinematics import Leg, Limb, foot_points, pose_data, sides
from lacoloco.robots.importing.similarity import (
    SWING_SPEED,
    Size,
    biped_numbers,
    quadruped_numbers,
)
from lacoloco.robots.importing.source import Source
from lacoloco.robots.loading import TOML

if TYPE_CHECKING:
    import mujoco

TRAINING_EFFORT = 1.5
"""Torque limit of training in those of the motor: who trains learns from its excess."""
MOCAP = {"FL": ("LeftHand", "LeftShoulder"), "FR": ("RightHand", "RightShoulder")}
MOCAP |= {"HL": ("LeftFoot", "LeftUpLeg"), "HR": ("RightFoot", "RightUpLeg")}
"""Corner of a quadruped -> joints of the dog skeleton at its foot and at its hip."""
HAND = 3
"""A limb of so many joints or more that is no leg is an arm."""


@dataclass(frozen=True)
class Question:
    """What a file does not say.

    Attributes:
        key: File and key to fill in.
        what: What belongs there.
        assumed: What stands there until then; "" for nothing.
    """

    key: str
    what: str
    assumed: str = ""


@dataclass(frozen=True)
class Facts:
    """What was found out about a robot; (J,) by joint, F feet in the order of the legs.

    Attributes:
        source: What it was read from.
        model: The bare robot, before its feet became bodies.
        limbs: All chains of hinges.
        legs: Those that stand.
        feet: Bodies of the feet.
        angles: Standing pose, rad.
        gains: Proposed.
        efforts: Torque limits, N.m; 0: unknown.
        solved: Whether the pose was solved, since no keyframe shows one that stands.
    """

    source: Source
    model: mujoco.MjModel
    limbs: list[Limb]
    legs: list[Leg]
    feet: tuple[str, ...]
    angles: np.ndarray
    gains: Gains
    efforts: np.ndarray
    solved: bool


def write_toml(facts: Facts, final: mujoco.MjModel, name: str) -> tuple[str, list[Question]]:
    """The text of robot.toml, and the questions.

    Args:
        facts: What was found.
        final: The robot as it is written.
        name: Of the robot.
    """
    biped = len(facts.legs) == 2
    height = standing_height(final, facts.angles, facts.feet)
    gravity = float(np.linalg.norm(final.opt.gravity))
    end, offset, reach = _end_effector(facts)
    speeds = _speeds(facts, float(np.sqrt(height / gravity)))
    point = _point(final, facts.angles, end, offset) + (0.0, 0.0, height)
    size = Size(
        height=height,
        weight=float(final.body_mass.sum()) * gravity,
        gravity=gravity,
        foot=point,
        reach=reach,
        compliance=_compliance(facts),
    )
    low, high = _joint_scale(facts, biped)
    position, velocity = clip_gains(facts.gains, final.dof_damping.reshape(final.nv, -1)[6:, 0])
    fall, undesired = _bodies(facts, final)
    values = {
        **(biped_numbers(size) if biped else quadruped_numbers(size)),
        "position_gain": position,
        "velocity_gain": velocity,
        "joint_low": low,
        "joint_high": high,
    }
    texts = {key: _number(value) for key, value in values.items()} | {
        "name": name,
        "source": facts.source.file.name,
        "abduction": _names(
            [_joint(facts, leg.abduction) for leg in facts.legs if leg.abduction > 0]
        ),
        "joints": "\n".join(_joint_rows(facts, speeds)),
        "end_body": end,
        "end_offset": _number(offset.tolist()),
        "feet": _names(facts.feet),
        "fall": _names(fall),
        "undesired": _names(undesired),
        "self_collision": str(facts.source.self_collision).lower(),
        "knees": _names([_body_of(facts, leg.knee) for leg in facts.legs if leg.knee > 0]),
        "keypoints": _keypoints(facts),
    }
    template = Path(__file__).with_name("biped.toml" if biped else "quadruped.toml")
    return Template(template.read_text()).substitute(texts), _questions(facts, name, speeds, end)


def _questions(facts: Facts, name: str, speeds: np.ndarray, end: str) -> list[Question]:
    """What has to be looked up, most needed first."""
    model, mjcf, toml = facts.model, f"{name}.xml", TOML
    names = [model.joint(j).name for j in range(1, model.njnt)]
    questions = []

    def ask(key: str, what: str, missing: np.ndarray, assumed: str = "") -> None:
        if missing.any():
            of = ", ".join(n for n, gone in zip(names, missing, strict=True) if gone)
            of = "every joint" if missing.all() else of
            questions.append(Question(key, f"{what} of {of}", assumed))

    limited = model.jnt_limited[1:].astype(bool)
    ask(f"{mjcf}: joint: actuatorfrcrange", "torque limit, N.m,", facts.efforts <= 0.0)
    ask(f"{mjcf}: joint: range", "range, rad,", ~limited)
    known = np.array([n in facts.source.speeds for n in names])
    assumed = f"{speeds[~known].max():.3g} rad/s, a fast swing" if (~known).any() else ""
    ask(f"{toml}: joints: speed", "speed limit of the motor, rad/s,", ~known, assumed)
    ask(
        f"{mjcf}: joint: armature",
        "inertia of the rotor behind the gear, kg.m2,",
        model.dof_armature[6:] <= 0.0,
        "none",
    )
    if facts.solved:
        what = "standing pose, rad: the file has no keyframe that stands"
        questions.append(Question(f"{toml}: joints: default", what, "legs bent under the hips"))
    if len(facts.legs) == 2:
        what = "the body that reaches, and the point of it"
        questions.append(Question(f"{toml}: end_effector", what, end))
    return questions


def _joint_rows(facts: Facts, speeds: np.ndarray) -> list[str]:
    rows = []
    for j in range(facts.model.njnt - 1):
        joint, effort = facts.model.joint(j + 1).name, float(facts.efforts[j])
        row = {
            "default": float(facts.angles[j]),
            "stiffness": float(facts.gains.stiffness[j]),
            "damping": float(facts.gains.damping[j]),
            "training_effort": TRAINING_EFFORT * effort,
            "speed": float(speeds[j]),
        }
        said = ", ".join(f"{key} = {value + 0.0:.10g}" for key, value in row.items())
        unknown = {"default": facts.solved, "speed": joint not in facts.source.speeds}
        asked = ", ".join(key for key, is_unknown in unknown.items() if is_unknown)
        rows.append(f'"{joint}" = {{ {said} }}' + (f" # {asked}: ASK" if asked else ""))
    return rows


def _speeds(facts: Facts, second: float) -> np.ndarray:
    """(J,) speed limits, rad/s; that of a fast swing where none is known."""
    assumed = float(rounded(np.array([SWING_SPEED / second]))[0])
    names = [facts.model.joint(j).name for j in range(1, facts.model.njnt)]
    return np.array([facts.source.speeds.get(name, assumed) for name in names])


def _joint_scale(facts: Facts, biped: bool) -> tuple[float, float]:
    """Factors on the standing pose at resets that leave every joint within its range."""
    low, high = (0.9, 1.1) if biped else (0.5, 1.5)
    lower, upper = facts.model.jnt_range[1:].T
    for angle, least, most, limited in zip(
        facts.angles, lower, upper, facts.model.jnt_limited[1:], strict=True
    ):
        if not limited or angle == 0.0:
            continue
        bounds = sorted((least / angle, most / angle))
        low, high = max(low, min(bounds[0], 1.0)), min(high, max(bounds[1], 1.0))
    return float(np.ceil(low * 100) / 100), float(np.floor(high * 100) / 100)


def _end_effector(facts: Facts) -> tuple[str, np.ndarray, float]:
    """Body that reaches, the point of it, and how far its limb reaches.

    A hand: the right one of those arms that have most joints. Without arms: the right front foot.
    """
    model, data = facts.model, pose_data(facts.model, facts.angles)
    standing = {leg.limb.end for leg in facts.legs}
    arms = [limb for limb in facts.limbs if limb.end not in standing and len(limb.joints) >= HAND]
    if arms:
        most = max(len(limb.joints) for limb in arms)
        arm = min(
            (limb for limb in arms if len(limb.joints) == most),
            key=lambda limb: float(data.xpos[limb.end, 1]),
        )
        offset = np.round(_far_point(model, arm.end), 3)
        return model.body(arm.end).name, offset, _length(data, arm.joints, offset)
    points = foot_points(model, data, facts.legs)
    corners = sides({str(i): point for i, point in enumerate(points)})
    chosen = int(corners["FR"]) if corners else int(np.argmax(points[:, 0] - points[:, 1]))
    leg = facts.legs[chosen]
    swings = [joint for joint in leg.limb.joints if joint != leg.abduction]
    return facts.feet[chosen], np.zeros(3), _length(data, swings, leg.centre)


def _compliance(facts: Facts) -> float:
    """Median over the legs' joints of the deflection that asks for all the torque, rad."""
    legs = [joint - 1 for leg in facts.legs for joint in leg.limb.joints]
    efforts, stiffness = facts.efforts[legs], facts.gains.stiffness[legs]
    known = efforts > 0.0
    return float(np.median((efforts / stiffness)[known])) if known.any() else 0.75


def _far_point(model: mujoco.MjModel, body: int) -> np.ndarray:
    """The point of a body and what is welded to it that is farthest along its centre of mass."""
    direction = model.body_ipos[body] / max(float(np.linalg.norm(model.body_ipos[body])), 1e-9)
    extents = [float(model.body_ipos[body] @ direction)]
    for geom in range(model.ngeom):
        if model.geom_bodyid[geom] == body:
            near = model.geom_rbound[geom]
            centre = float(model.geom_pos[geom] @ direction)
            extents.append(centre + min(float(near), centre) if centre > 0 else 0.0)
    return np.asarray(direction * max(extents))


def _length(data: mujoco.MjData, joints: Sequence[int], last: np.ndarray) -> float:
    anchors = data.xanchor[list(joints)]
    return float(np.linalg.norm(np.diff(anchors, axis=0), axis=1).sum() + np.linalg.norm(last))


def _point(model: mujoco.MjModel, angles: np.ndarray, body: str, offset: np.ndarray) -> np.ndarray:
    """(3,) a point in the frame of the base in the standing pose, m."""
    data = pose_data(model, angles)
    number = model.body(body).id
    return np.asarray(data.xpos[number] + data.xmat[number].reshape(3, 3) @ offset)


def _bodies(facts: Facts, final: mujoco.MjModel) -> tuple[list[str], list[str]]:
    """Bodies whose contact is a fall, and those whose contact is a mistake; with shapes that touch.

    A fall is the trunk's, and that of whatever is no leg. A mistake is a leg's above the knee, or
    of a robot on two legs the whole leg's but the foot.
    """
    legs = {int(facts.model.jnt_bodyid[j]): leg for leg in facts.legs for j in leg.limb.joints}
    names = {facts.model.body(b).name: leg for b, leg in legs.items()}
    fall, mistake = [], []
    for body in range(1, final.nbody):
        name = final.body(body).name
        if name in facts.feet or not _touches(final, body):
            continue
        carrier = final.body(final.body_weldid[body]).name
        if carrier not in names:
            fall.append(name)
        elif len(facts.legs) == 2 or not _below_knee(facts, names[carrier], carrier):
            mistake.append(name)
    base = final.body(1).name
    return fall or [base], mistake


def _below_knee(facts: Facts, leg: Leg, body: str) -> bool:
    number = int(facts.model.body_jntadr[facts.model.body(body).id])
    return leg.knee > 0 and number >= leg.knee


def _touches(model: mujoco.MjModel, body: int) -> bool:
    first = int(model.body_geomadr[body])
    own = range(first, first + int(model.body_geomnum[body]))
    return any(model.geom_contype[g] or model.geom_conaffinity[g] for g in own)


def _keypoints(facts: Facts) -> str:
    """The table of keypoints of a quadruped, for the dog skeleton; "" for any other robot."""
    points = foot_points(facts.model, pose_data(facts.model, facts.angles), facts.legs)
    corners = sides({str(i): point for i, point in enumerate(points)})
    if not corners:
        return ""
    lines = ["", "[retargeting.keypoints] # joint of the dog skeleton -> body"]
    for corner, (foot, hip) in MOCAP.items():
        leg = facts.legs[int(corners[corner])]
        lines.append(f'{foot} = "{facts.feet[int(corners[corner])]}"')
        lines.append(f'{hip} = "{_body_of(facts, leg.limb.joints[0])}"')
    return "\n".join([*lines, ""])


def _joint(facts: Facts, joint: int) -> str:
    return str(facts.model.joint(joint).name)


def _body_of(facts: Facts, joint: int) -> str:
    return str(facts.model.body(facts.model.jnt_bodyid[joint]).name)


def _names(names: list[str] | tuple[str, ...]) -> str:
    return "[" + ", ".join(f'"{name}"' for name in names) + "]"


def _number(value: float | list[float]) -> str:
    if isinstance(value, list):
        return "[" + ", ".join(_number(item) for item in value) + "]"
    text = f"{value + 0.0:.4g}"
    return text if "." in text or "e" in text else f"{text}.0"
