"""From the two files of a robot, ``robot.toml`` and its MJCF, to a :class:`RobotSpec`."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any

from lacoloco.robots import mjcf
from lacoloco.robots.errors import RobotError
from lacoloco.robots.joint_rows import Rows, joint_rows
from lacoloco.robots.numbers import (
    Gait,
    InverseDynamics,
    ObservationNoise,
    OdometryDrift,
    SkillThresholds,
    Terminations,
    TrackingTolerances,
)
from lacoloco.robots.spec import EndEffector, RobotSpec
from lacoloco.robots.tables import (
    NonNegative,
    Place,
    Positive,
    Range,
    Rule,
    nearest,
    parse_toml,
    read_table,
)

TOML = "robot.toml"


@dataclass(frozen=True)
class JointRow:
    """What ``[joints]`` says of one joint.

    Attributes:
        default: Position in the default pose, rad.
        stiffness: Proportional gain, N.m/rad.
        damping: Derivative gain, N.m.s/rad.
        training_effort: Torque limit while training, N.m.
        speed: Speed limit of the motor, rad/s.
    """

    default: float
    stiffness: NonNegative
    damping: NonNegative
    training_effort: NonNegative
    speed: NonNegative


@dataclass(frozen=True)
class RetargetingRow:
    """What ``[retargeting.joints]`` says of one joint.

    Attributes:
        neutral: Position the retargeting is drawn to, rad; the default pose where it is missing.
        range: Bounds of the retargeting, rad; the joint's range where it is missing.
    """

    neutral: float | None = None
    range: Range | None = None


@dataclass(frozen=True)
class ActionSection:
    """``[actions]``.

    Attributes:
        scale: Radians per unit of action.
        walk_scale: Radians per unit of action of the walking expert.
    """

    scale: Positive
    walk_scale: Positive


@dataclass(frozen=True)
class ContactSection:
    """``[contacts]``.

    Attributes:
        feet: Bodies that may touch the ground.
        fall_bodies: Bodies whose contact is a fall.
        undesired_bodies: Bodies whose contact is a mistake but not a fall.
        foot_force_limit: Limit of the force on one foot, in multiples of the robot's weight.
        self_collision: Whether the robot's own bodies collide with each other.
    """

    feet: tuple[str, ...]
    fall_bodies: tuple[str, ...]
    foot_force_limit: Annotated[
        float, Rule("a multiple of the weight, above 0 and at most 20", lambda x: 0 < x <= 20)
    ]
    self_collision: bool
    undesired_bodies: tuple[str, ...] = ()


@dataclass(frozen=True)
class RetargetingSection:
    """``[retargeting]``: how motion capture becomes a motion of the robot.

    Attributes:
        keypoints: Mocap joint -> body or point of this robot.
        points: Name -> body and offset, m: points that follow joints as bodies do.
        soles: Foot -> its heel and its toes, two of the points.
        knees: Bodies whose origin stays above the ground.
        joints: Rows by joint, see :class:`RetargetingRow`.
    """

    keypoints: Mapping[str, str] = field(default_factory=dict)
    points: Mapping[str, EndEffector] = field(default_factory=dict)
    soles: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    knees: tuple[str, ...] = ()
    joints: Rows = field(default_factory=dict)


@dataclass(frozen=True)
class RobotFile:
    """The whole ``robot.toml``."""

    name: str
    joints: Rows
    actions: ActionSection
    end_effector: EndEffector
    contacts: ContactSection
    skills: SkillThresholds
    tracking: TrackingTolerances
    inverse_dynamics: InverseDynamics
    terminations: Terminations
    tasks: Mapping[str, Any]
    mjcf: str = ""
    abduction_joints: tuple[str, ...] = ()
    observation_noise: ObservationNoise = field(default_factory=ObservationNoise)
    odometry: OdometryDrift = field(default_factory=OdometryDrift)
    gait: Gait | None = None
    hindsight: Mapping[str, float] = field(default_factory=dict)  # of before; nothing reads it
    retargeting: RetargetingSection = field(default_factory=RetargetingSection)


def load_folder(path: Path) -> RobotSpec:
    """The robot in the folder ``path``, or in the folder of the file ``path`` (its robot.toml).

    Raises:
        RobotError: A file is missing, or something in it is wrong; one line that says what.
    """
    folder = path.parent if path.name == TOML else path
    if not (folder / TOML).is_file():
        raise RobotError(f"{folder}: no robot there: a robot is a folder with {TOML} and its MJCF")
    toml = _read_text(folder / TOML)
    values = parse_toml(toml, str(folder / TOML))
    model = _mjcf_name(values, Place(str(folder / TOML)))
    if not (folder / model).is_file():
        raise RobotError(f"{folder / model}: no such MJCF; write it, or set `mjcf` in {TOML}")
    return robot_from_files({TOML: toml, model: _read_text(folder / model)}, folder)


def robot_from_files(files: Mapping[str, str], folder: Path | None = None) -> RobotSpec:
    """The robot that :meth:`RobotSpec.files` gave the texts of.

    Args:
        files: Name -> text: ``robot.toml`` and the MJCF that it names.
        folder: Where they were read from. It may be gone, or hold other texts by now: then the
            robot has no meshes.

    Raises:
        RobotError: A text is missing, or something in it is wrong; one line that says what.
    """
    folder = Path() if folder is None else folder
    place = Place(str(folder / TOML))
    if TOML not in files:
        raise RobotError(f"{place.file}: missing; a robot is {TOML} and its MJCF")
    values = parse_toml(files[TOML], place.file)
    model = _mjcf_name(values, place)
    if model not in files:
        raise RobotError(f"{folder / model}: missing; {TOML} names this MJCF")
    described = read_table(RobotFile, values, place)
    return _spec(described, model, files, folder, place)


def _mjcf_name(values: Mapping[str, Any], place: Place) -> str:
    """The name of the MJCF beside a robot.toml with these values."""
    for key in ("name", "mjcf"):
        if key in values and not isinstance(values[key], str):
            (place / key).expected("a text", values[key])
    if "name" not in values:
        (place / "name").fail("missing; expected a text")
    if not re.fullmatch(r"[A-Za-z0-9][A-Za-z0-9_.-]*", values["name"]):
        (place / "name").expected("letters, digits, '_', '-' and '.'", values["name"])
    file = values.get("mjcf", f"{values['name']}.xml")
    if Path(file).name != file:
        (place / "mjcf").expected("the name of a file in the robot's folder", file)
    return file


def _spec(
    file: RobotFile, model: str, files: Mapping[str, str], folder: Path, place: Place
) -> RobotSpec:
    bare = mjcf.bare_model(files[model], folder / model)
    names = [bare.joint(i).name for i in range(bare.njnt)]
    if names[:1] != ["root_joint"] or len(names) < 2:
        raise RobotError(f"{folder / model}: the first joint must be the free joint 'root_joint'")
    joints = tuple(names[1:])
    _check_bodies(file, {bare.body(i).name for i in range(1, bare.nbody)}, place)
    for name in file.abduction_joints:
        if name not in joints:
            where = place / "abduction_joints"
            where.fail(f"joint {name!r} is not in the MJCF; {nearest(name, joints)}")
    rows = joint_rows(JointRow, file.joints, joints, place / "joints")
    where = place / "retargeting" / "joints"
    sketched = joint_rows(RetargetingRow, file.retargeting.joints, joints, where)
    bounds = [
        row.range or tuple(map(float, limits))
        for row, limits in zip(sketched, bare.jnt_range[1:], strict=True)
    ]
    return RobotSpec(
        name=file.name,
        folder=folder,
        mjcf_name=model,
        sources=((TOML, files[TOML]), (model, files[model])),
        joint_names=joints,
        default_joint_pos=tuple(row.default for row in rows),
        stiffness=tuple(row.stiffness for row in rows),
        damping=tuple(row.damping for row in rows),
        action_scale=file.actions.scale,
        walk_action_scale=file.actions.walk_scale,
        training_effort_limits=tuple(row.training_effort for row in rows),
        velocity_limits=tuple(row.speed for row in rows),
        end_effector=file.end_effector,
        feet=file.contacts.feet,
        fall_bodies=file.contacts.fall_bodies,
        undesired_contact_bodies=file.contacts.undesired_bodies,
        contact_force_limit=file.contacts.foot_force_limit,
        self_collision=file.contacts.self_collision,
        keypoints=file.retargeting.keypoints,
        points=file.retargeting.points,
        soles=file.retargeting.soles,
        retarget_neutral=tuple(
            row.default if sketch.neutral is None else sketch.neutral
            for row, sketch in zip(rows, sketched, strict=True)
        ),
        retarget_lower=tuple(low for low, _ in bounds),
        retarget_upper=tuple(high for _, high in bounds),
        knee_frames=file.retargeting.knees,
        abduction_joints=file.abduction_joints,
        observation_noise=file.observation_noise,
        odometry=file.odometry,
        skills=file.skills,
        tracking=file.tracking,
        inverse_dynamics=file.inverse_dynamics,
        terminations=file.terminations,
        gait=file.gait,
        tasks=file.tasks,
    )


def _check_bodies(file: RobotFile, bodies: set[str], place: Place) -> None:
    """Every body that robot.toml names is in the MJCF."""
    contacts, retargeting = file.contacts, file.retargeting
    _check_points(retargeting, bodies, contacts.feet, place / "retargeting")
    followers = tuple(v for v in retargeting.keypoints.values() if v not in retargeting.points)
    named = {
        place / "contacts" / "feet": contacts.feet,
        place / "contacts" / "fall_bodies": contacts.fall_bodies,
        place / "contacts" / "undesired_bodies": contacts.undesired_bodies,
        place / "end_effector" / "body": (file.end_effector.body,),
        place / "retargeting" / "keypoints": followers,
        place / "retargeting" / "knees": retargeting.knees,
    }
    for key, names in (("feet", contacts.feet), ("fall_bodies", contacts.fall_bodies)):
        if not names:
            (place / "contacts" / key).expected("at least one body", [])
    for where, names in named.items():
        for name in names:
            if name not in bodies:
                where.fail(f"body {name!r} is not in the MJCF; {nearest(name, sorted(bodies))}")


def _check_points(
    retargeting: RetargetingSection, bodies: set[str], feet: tuple[str, ...], place: Place
) -> None:
    """Points lie on bodies of the MJCF; soles are two points of their foot, of all feet or none."""
    for name, point in retargeting.points.items():
        where = place / "points" / name
        if name in bodies:
            where.fail("is the name of a body; choose another one")
        if point.body not in bodies:
            (where / "body").fail(
                f"body {point.body!r} is not in the MJCF; {nearest(point.body, sorted(bodies))}"
            )
    for foot, sole in retargeting.soles.items():
        where = place / "soles" / foot
        if foot not in feet:
            where.fail(f"no foot of [contacts]; {nearest(foot, feet)}")
        own = [name for name, point in retargeting.points.items() if point.body == foot]
        if len(set(sole)) != 2 or not set(sole) <= set(own):
            where.expected(f"the heel and the toes, two points of {foot} in [points]", list(sole))
    if retargeting.soles and set(retargeting.soles) != set(feet):
        (place / "soles").fail("give all feet a heel and toes, or none")


def _read_text(file: Path) -> str:
    try:
        return file.read_bytes().decode()
    except (OSError, UnicodeDecodeError) as error:
        raise RobotError(f"{file}: cannot be read as text: {error}") from error
