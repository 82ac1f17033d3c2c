"""Does a robot hold together: its spec, and the same MJCF read by MuJoCo and by Pinocchio?"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from lacoloco.robots.agreement import Disagreement, compare_engines
from lacoloco.robots.errors import RobotError
from lacoloco.robots.geometry import colliding_meshes
from lacoloco.robots.scene import compile_scene

if TYPE_CHECKING:
    from lacoloco.robots.spec import RobotSpec

POSES = 200  # random poses the two engines are compared at
KINEMATICS_TOLERANCE = 1e-12  # m, and entries of rotation matrices
DYNAMICS_TOLERANCE = 1e-10  # kg.m2 and N.m
MASS_TOLERANCE = 1e-9  # kg
KEYFRAME_TOLERANCE = 1e-9  # m and rad
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
ROUNDING = 1e-3  # rad; published joint limits are rounded to three digits


@dataclass(frozen=True)
class Check:
    """One line of the report: ``value`` must not exceed ``limit``."""

    name: str
    value: float
    limit: float
    unit: str = ""
    detail: str = ""

    @property
    def passed(self) -> bool:
        """Whether the value is within the limit (NaN is not)."""
        return bool(self.value <= self.limit)


@dataclass(frozen=True)
class CheckReport:
    """Every check of one robot."""

    robot: str
    model_hash: str
    total_mass: float
    checks: tuple[Check, ...]

    @property
    def passed(self) -> bool:
        """Whether all checks passed."""
        return all(check.passed for check in self.checks)

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
    checks += _engine_checks(compare_engines(spec, poses=poses, seed=seed))
    checks += [*_limit_checks(spec), *_pose_checks(spec)]
    return CheckReport(spec.name, spec.model_hash(), spec.total_mass(), tuple(checks))


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
    yield _names("joint order in MuJoCo", expected, joints)
    yield _names("joint order in Pinocchio", expected, list(pinocchio_model.names)[1:])
    bodies = {model.body(i).name for i in range(model.nbody)}
    frames = {frame.name for frame in pinocchio_model.frames}
    named = {
        *spec.contact_bodies,
        spec.end_effector.body,
        *spec.keypoints.values(),
        *spec.knee_frames,
    }
    absent = sorted(named - (bodies & frames))
    yield Check("bodies of the spec missing", len(absent), 0, detail=", ".join(absent))


def _names(name: str, expected: list[str], found: list[str]) -> Check:
    wrong = [f"{e} where the MJCF has {f}" for e, f in zip(expected, found, strict=False) if e != f]
    if len(expected) != len(found):
        wrong.append(f"{len(expected)} joints where the MJCF has {len(found)}")
    return Check(name, len(wrong), 0, detail="; ".join(wrong[:2]))


def _engine_checks(d: Disagreement) -> Iterator[Check]:
    yield Check("positions, MuJoCo - Pinocchio", d.position, KINEMATICS_TOLERANCE, "m")
    yield Check("rotations, MuJoCo - Pinocchio", d.rotation, KINEMATICS_TOLERANCE)
    yield Check("mass matrix, MuJoCo - Pinocchio", d.mass_matrix, DYNAMICS_TOLERANCE, "kg.m2")
    yield Check("gravity torque, MuJoCo - Pinocchio", d.gravity, DYNAMICS_TOLERANCE, "N.m")
    yield Check("total mass, MuJoCo - Pinocchio", d.total_mass, MASS_TOLERANCE, "kg")
    yield Check("joint limits, MuJoCo - Pinocchio", d.joint_limits, 0, "rad")
    yield Check("effort limits, MuJoCo - Pinocchio", d.effort_limits, 0, "N.m")


def _excess(pose: Sequence[float], lower: np.ndarray, upper: np.ndarray) -> float:
    """How far the worst joint lies outside its limits, rad; 0 if none does."""
    q = np.asarray(pose)
    return float(np.maximum(lower - q, q - upper).max().clip(0.0))


def _not_positive(values: Sequence[float]) -> int:
    return sum(not value > 0 for value in values)


def _limit_checks(spec: RobotSpec) -> Iterator[Check]:
    lower, upper = spec.joint_limits()
    effort = spec.effort_limits()

    yield Check("joints without range", int((lower >= upper).sum()), 0)
    yield Check("joints without effort limit", int((effort <= 0).sum()), 0)
    yield Check(
        "default pose beyond limits", _excess(spec.default_joint_pos, lower, upper), 0, "rad"
    )
    low, high = np.array(spec.retarget_lower), np.array(spec.retarget_upper)
    yield Check("neutral pose beyond bounds", _excess(spec.retarget_neutral, low, high), 0, "rad")
    beyond = max(
        _excess(spec.retarget_lower, lower, upper), _excess(spec.retarget_upper, lower, upper)
    )
    yield Check("retarget bounds beyond limits", beyond, ROUNDING, "rad")
    weaker = float((effort - spec.training_effort_limits).max().clip(0.0))
    yield Check("motor torque beyond training torque", weaker, 0, "N.m")
    yield Check("gains not positive", _not_positive((*spec.stiffness, *spec.damping)), 0)
    yield Check("speed limits not positive", _not_positive(spec.velocity_limits), 0)
    model = spec.model()
    solid = [model.geom(g).bodyid[0] for g in colliding_meshes(model)]
    detail = ", ".join(sorted({model.body(b).name for b in solid}))
    yield Check("meshes that collide", len(solid), 0, detail=detail)


def _pose_checks(spec: RobotSpec) -> Iterator[Check]:
    """The default pose stands on its feet and touches nothing else, not even itself."""
    import mujoco

    model = compile_scene(spec)
    if model.nkey == 0:
        yield Check("keyframe missing", 1, 0, detail="the MJCF needs one with the default pose")
        return
    off = float(np.abs(model.key_qpos[0] - spec.default_qpos()).max())
    yield Check("keyframe - default pose", off, KEYFRAME_TOLERANCE, "m, rad")
    data = mujoco.MjData(model)
    data.qpos[:] = spec.default_qpos()
    data.qpos[2] -= 1e-4  # into the floor, so that what touches is found in spite of rounding
    mujoco.mj_forward(model, data)
    touching = {model.body(model.geom_bodyid[g]).name for c in data.contact for g in c.geom}
    odd = sorted(touching - {"world", *spec.feet})
    yield Check("touching in the default pose, but no foot", len(odd), 0, detail=", ".join(odd))
    idle = sorted(set(spec.feet) - touching)
    yield Check("feet in the air in the default pose", len(idle), 0, detail=", ".join(idle))
