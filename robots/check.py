"""Does a robot hold together: its spec, and the same MJCF read by MuJoCo and by Pinocchio?"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING

from lacoloco.robots.agreement import Disagreement, compare_engines
from lacoloco.robots.check_numbers import limit_checks, pose_checks, stance_checks
from lacoloco.robots.errors import RobotError
from lacoloco.robots.finding import Check, sound
from lacoloco.robots.stance import Stance, stand

if TYPE_CHECKING:
    from lacoloco.robots.spec import RobotSpec

POSES = 200  # random poses the two engines are compared at
KINEMATICS_TOLERANCE = 1e-12  # m, and entries of rotation matrices
DYNAMICS_TOLERANCE = 1e-10  # kg.m2 and N.m
MASS_TOLERANCE = 1e-9  # kg
PER_JOINT = (
    "default_joint_pos",
    "stiffness",
    "damping",
    "training_effort_limits",
    "velocity_limits",
    "retarget_neutral",
    "retarget_lower",
    "retarget_upper",
)


@dataclass(frozen=True)
class CheckReport:
    """Every check of one robot.

    Attributes:
        robot: Its name.
        model_hash: Of its MJCF.
        total_mass: kg.
        checks: What was checked.
        stance: How it stands under its gains; None where something else is wrong.
    """

    robot: str
    model_hash: str
    total_mass: float
    checks: tuple[Check, ...]
    stance: Stance | None = None

    @property
    def passed(self) -> bool:
        """Whether all checks passed."""
        return sound(self.checks)

    def failures(self) -> tuple[Check, ...]:
        """The checks that did not pass."""
        return tuple(check for check in self.checks if not check.passed)


def check_robot(spec: RobotSpec, *, poses: int = POSES, seed: int = 0) -> CheckReport:
    """Check a robot.

    Args:
        spec: The robot.
        poses: Random poses at which MuJoCo and Pinocchio are compared.
        seed: Seed of those poses.

    Returns:
        The report; what is merely wrong is a failed check in it.

    Raises:
        RobotError: The robot is too broken to be compared: the MJCF does not load, a body or
            joint of the spec is missing, or a tuple has the wrong length.
    """
    _require_lengths(spec)
    checks = [*_name_checks(spec)]
    missing = [c for c in checks if not c.passed]
    if missing:
        raise RobotError(f"robot {spec.name!r}: {missing[0].name}: {missing[0].detail}")
    checks += limit_checks(spec)
    checks += _engine_checks(spec, compare_engines(spec, poses=poses, seed=seed))
    stance = None
    if sound(checks):  # else how it stands only repeats what is wrong already
        checks += pose_checks(spec)
        stance = stand(spec)
        checks += stance_checks(spec, stance)
    return CheckReport(spec.name, spec.model_hash(), spec.total_mass(), tuple(checks), stance)


def _require_lengths(spec: RobotSpec) -> None:
    for name in PER_JOINT:
        found = len(getattr(spec, name))
        if found != spec.num_joints:
            raise RobotError(
                f"robot {spec.name!r}: {name} has {found} values for {spec.num_joints} joints"
            )


def _name_checks(spec: RobotSpec) -> Iterator[Check]:
    """Joints and bodies of the spec exist in both engines, joints in the same order."""
    model, pinocchio_model = spec.model(), spec.pinocchio_model()
    joints = [model.joint(i).name for i in range(model.njnt)]
    expected = ["root_joint", *spec.joint_names]
    yield _names(spec, "joint order in MuJoCo", expected, joints)
    yield _names(spec, "joint order in Pinocchio", expected, list(pinocchio_model.names)[1:])
    bodies = {model.body(i).name for i in range(model.nbody)}
    frames = {frame.name for frame in pinocchio_model.frames}
    named = {
        *spec.contact_bodies,
        spec.end_effector.body,
        *spec.located(spec.keypoints.values())[0],
        *spec.knee_frames,
    }
    absent = sorted(named - (bodies & frames))
    detail = ", ".join(absent)
    yield Check("bodies of the spec missing", len(absent), 0, "", str(spec.mjcf), detail)


def _names(spec: RobotSpec, name: str, expected: list[str], found: list[str]) -> Check:
    wrong = [f"{e} where the MJCF has {f}" for e, f in zip(expected, found, strict=False) if e != f]
    if len(expected) != len(found):
        wrong.append(f"{len(expected)} joints where the MJCF has {len(found)}")
    return Check(name, len(wrong), 0, "", str(spec.mjcf), "; ".join(wrong[:2]))


def _engine_checks(spec: RobotSpec, d: Disagreement) -> Iterator[Check]:
    for name, value, limit, unit in (
        ("positions", d.position, KINEMATICS_TOLERANCE, "m"),
        ("rotations", d.rotation, KINEMATICS_TOLERANCE, ""),
        ("mass matrix", d.mass_matrix, DYNAMICS_TOLERANCE, "kg.m2"),
        ("gravity torque", d.gravity, DYNAMICS_TOLERANCE, "N.m"),
        ("total mass", d.total_mass, MASS_TOLERANCE, "kg"),
        ("joint limits", d.joint_limits, 0.0, "rad"),
        ("effort limits", d.effort_limits, 0.0, "N.m"),
    ):
        detail = f"MuJoCo and Pinocchio read different {name}: they are {value:.3g} {unit}".rstrip()
        detail += f" apart, expected at most {limit:g}"
        yield Check(f"{name}, MuJoCo - Pinocchio", value, limit, unit, str(spec.mjcf), detail)
