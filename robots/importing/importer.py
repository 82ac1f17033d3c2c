"""A published MJCF or URDF becomes the folder of a robot."""

from __future__ import annotations

import os
import re
import shutil
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from fnmatch import fnmatchcase
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from lacoloco.robots import mjcf
from lacoloco.robots.errors import RobotError
from lacoloco.robots.importing.actuators import drop_implausible, read_efforts, unpowered
from lacoloco.robots.importing.feet import give_feet_bodies
from lacoloco.robots.importing.firmness import stand_firmly
from lacoloco.robots.importing.gains import propose_gains
from lacoloco.robots.importing.kinematics import (
    find_legs,
    find_limbs,
    foot_points,
    pose_data,
)
from lacoloco.robots.importing.posture import keyframe_angles, standing_angles, untouching
from lacoloco.robots.importing.proposal import Facts, Question, write_toml
from lacoloco.robots.importing.source import Source, read_source
from lacoloco.robots.importing.writing import MESHES, Canonical, numbers, write_canonical
from lacoloco.robots.loading import TOML
from lacoloco.robots.registry import robot_folders

if TYPE_CHECKING:
    import mujoco


@dataclass(frozen=True)
class Imported:
    """A robot that was imported.

    Attributes:
        folder: With robot.toml, the MJCF and the meshes.
        notes: What was read, left out or changed, a line each.
        questions: What the file does not say and the user may know.
    """

    folder: Path
    notes: tuple[str, ...]
    questions: tuple[Question, ...] = field(default=())


def import_robot(file: Path, name: str, robots: Path, *, fixed: Sequence[str] = ()) -> Imported:
    """Make the folder ``robots / name``.

    Args:
        file: MJCF or URDF, with its meshes where it says they are.
        name: Of the robot.
        robots: Folder of robot folders; made if need be.
        fixed: Joints, or patterns of joints, to weld in the standing pose.

    Raises:
        RobotError: The name or the folder cannot be taken, or the file cannot be a robot; one
            line. Nothing is left behind then.
    """
    if not re.fullmatch(r"[A-Za-z0-9][A-Za-z0-9_.-]*", name):
        raise RobotError(f"--name {name!r}: expected letters, digits, '_', '-' and '.'")
    target = robots / name
    if target.exists():
        raise RobotError(f"{target}: is there already; choose another name, or another --to")
    if (other := robot_folders().get(name)) is not None:
        raise RobotError(f"--name {name}: is another robot, in {other}; choose another name")
    with _made_for(robots), tempfile.TemporaryDirectory(prefix=f".{name}-", dir=robots) as work:
        folder = Path(work) / name
        folder.mkdir()
        source = read_source(file, Path(work) / "converted")
        questions = _fill(folder, source, name, fixed)
        os.replace(folder, target)
    return Imported(target, tuple(source.notes), tuple(questions))


@contextmanager
def _made_for(robots: Path) -> Iterator[None]:
    """Make a folder and those above it, and remove what was made where nothing comes of it.

    Raises:
        RobotError: The folder cannot be made.
    """
    made = [folder for folder in (robots, *robots.parents) if not folder.exists()]
    try:
        robots.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        told = (error.strerror or str(error)).lower()
        raise RobotError(f"--to {robots}: cannot be made: {told}; name another folder") from error
    try:
        yield
    except BaseException:
        for folder in made:
            with suppress(OSError):  # somebody put something there
                folder.rmdir()
        raise


def _fill(folder: Path, source: Source, name: str, fixed: Sequence[str]) -> list[Question]:
    """Write both files and copy the meshes."""
    model, notes = source.model, source.notes
    welded = _welded(source, fixed)
    canonical = write_canonical(
        model,
        source.base,
        name,
        source.file.parent,
        efforts=read_efforts(model),
        fixed=welded,
    )
    file = folder / f"{name}.xml"
    (folder / MESHES).mkdir()
    for copy, original in canonical.meshes.items():
        shutil.copyfile(original, folder / MESHES / copy)
    bare = _compile(canonical, file)
    if bare.njnt < 2:
        raise RobotError(f"{source.file}: no joint that a motor moves; expected legs")
    known = keyframe_angles(model, bare)
    seen = pose_data(bare, np.zeros(bare.nq - 7) if known is None else known)
    try:
        limbs = find_limbs(bare, seen)
        legs = find_legs(bare, seen, limbs)
    except RobotError as error:
        raise RobotError(f"{source.file}: {error}") from error
    angles, solved = standing_angles(bare, legs, known)
    feet = give_feet_bodies(canonical, bare, seen, legs)
    height = -float(foot_points(bare, pose_data(bare, angles), legs)[:, 2].min())
    if height <= 0.0:
        raise RobotError(f"{source.file}: its feet are above its base; expected z to point up")
    if odd := drop_implausible(canonical.root, bare, height):
        told = ", ".join(f"{joint} ({effort:g} N.m)" for joint, effort in odd.items())
        notes.append(f"torque limits that no such motor has were left out: {told}")
    named = np.array([bare.joint(j).name in odd for j in range(1, bare.njnt)])
    efforts = np.where(named, 0.0, np.maximum(bare.jnt_actfrcrange[1:, 1], 0.0))
    gains = propose_gains(bare, legs, angles, efforts)
    facts = Facts(source, bare, limbs, legs, tuple(feet), angles, gains, efforts, solved)
    model = _with_keyframe(canonical, file, angles, feet)
    notes += untouching(canonical, model, feet)
    text = canonical.text()
    file.write_text(text)
    final = mjcf.bare_model(text, file)
    facts, stance = stand_firmly(facts, final, text, name)
    notes.append(stance.said)
    toml, questions = write_toml(facts, final, name)
    (folder / TOML).write_text(toml)
    if not any((folder / MESHES).iterdir()):
        (folder / MESHES).rmdir()
    return questions


def _welded(source: Source, patterns: Sequence[str]) -> dict[str, float]:
    """Joint -> angle, rad, of those that are asked to be welded or that nothing drives."""
    import mujoco

    model = source.model
    hinges = [j for j in range(model.njnt) if model.jnt_type[j] == mujoco.mjtJoint.mjJNT_HINGE]
    names = {model.joint(j).name: j for j in hinges}
    for pattern in patterns:
        if not any(fnmatchcase(name, pattern) for name in names):
            raise RobotError(f"--fix {pattern}: no joint matches; it has {', '.join(names)}")
    asked = {name for name in names if any(fnmatchcase(name, p) for p in patterns)}
    idle = unpowered(model) - asked
    if idle:
        source.notes.append(f"welded, no motor drives them: {', '.join(sorted(idle))}")
    qpos = model.key_qpos[0] if model.nkey else model.qpos0
    angles = {}
    for name in asked | idle:
        joint = names[name]
        angle = float(qpos[model.jnt_qposadr[joint]])
        if model.jnt_limited[joint]:
            angle = float(np.clip(angle, *model.jnt_range[joint]))
        angles[name] = angle
    return angles


def _compile(canonical: Canonical, file: Path) -> mujoco.MjModel:
    text = canonical.text()
    file.write_text(text)
    return mjcf.bare_model(text, file)


def _with_keyframe(
    canonical: Canonical, file: Path, angles: np.ndarray, feet: Sequence[str]
) -> mujoco.MjModel:
    """Add the standing pose, the base as high as its feet ask for."""
    from xml.etree.ElementTree import SubElement

    from lacoloco.robots.geometry import standing_height

    height = standing_height(_compile(canonical, file), angles, feet)
    base = canonical.root.find("worldbody/body")
    assert base is not None, "the base was written"
    base.set("pos", numbers([0.0, 0.0, height]))
    keyframe = SubElement(canonical.root, "keyframe")
    qpos = numbers(np.concatenate([[0.0, 0.0, height, 1.0, 0.0, 0.0, 0.0], angles]))
    SubElement(keyframe, "key", name="default", qpos=qpos)
    return _compile(canonical, file)
