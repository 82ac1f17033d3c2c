"""Do the numbers of a robot fit its model: limits, gains, and how it stands?"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from lacoloco.robots.finding import Check
from lacoloco.robots.geometry import colliding_meshes
from lacoloco.robots.loading import TOML
from lacoloco.robots.scene import compile_scene
from lacoloco.robots.stance import SECONDS, Stance

if TYPE_CHECKING:
    from lacoloco.robots.spec import RobotSpec

KEYFRAME_TOLERANCE = 1e-9  # m and rad
ROUNDING = 1e-3  # rad; published joint limits are rounded to three digits


def limit_checks(spec: RobotSpec) -> Iterator[Check]:
    """Every number of a joint is one that its model and its motor allow."""
    joints, rows = f"{spec.folder / TOML}: joints", f"{spec.folder / TOML}: retargeting.joints"
    yield from _model_checks(spec)
    ranges, because = spec.joint_limits(), f"its range in {spec.mjcf_name}"
    pose = _Numbers("default pose beyond limits", joints, "default", "rad")
    yield pose.within(spec, spec.default_joint_pos, *ranges, because)
    for end, values in (("lower", spec.retarget_lower), ("upper", spec.retarget_upper)):
        bounds = _Numbers(f"{end} retarget bounds beyond limits", rows, "range", "rad", ROUNDING)
        yield bounds.within(spec, values, *ranges, because)
    bounded = (
        np.array(spec.retarget_lower),
        np.array(spec.retarget_upper),
        "its range of retargeting",
    )
    neutral = _Numbers("neutral pose beyond bounds", rows, "neutral", "rad")
    yield neutral.within(spec, spec.retarget_neutral, *bounded)
    torque = _Numbers("motor torque beyond training torque", joints, "training_effort", "N.m")
    motor = (spec.effort_limits(), np.full(spec.num_joints, np.inf), "the torque of its motor")
    yield torque.within(spec, spec.training_effort_limits, *motor)
    for key, values, unit in (
        ("stiffness", spec.stiffness, "N.m/rad"),
        ("damping", spec.damping, "N.m.s/rad"),
        ("speed", spec.velocity_limits, "rad/s"),
    ):
        yield _Numbers(f"{key} not positive", joints, key, unit).positive(spec, values)


def pose_checks(spec: RobotSpec) -> Iterator[Check]:
    """The default pose stands on its feet and touches nothing else, not even itself."""
    import mujoco

    model, feet = compile_scene(spec), f"{spec.folder / TOML}: contacts.feet"
    if model.nkey == 0:
        expected = "missing; expected the default pose of robot.toml"
        yield Check("keyframe missing", 1, 0, "", f"{spec.mjcf}: keyframe", expected)
        return
    errors = np.abs(model.key_qpos[0] - spec.default_qpos())
    worst = int(errors.argmax())
    expected = f"expected qpos[{worst}] = {spec.default_qpos()[worst]:.10g} as in {TOML}'s default"
    expected += f" pose on the floor, found {model.key_qpos[0][worst]:.10g}"
    key = ("m, rad", f"{spec.mjcf}: keyframe", expected)
    yield Check("keyframe - default pose", float(errors[worst]), KEYFRAME_TOLERANCE, *key)
    data = mujoco.MjData(model)
    data.qpos[:] = spec.default_qpos()
    data.qpos[2] -= 1e-4  # into the floor, so that what touches is found in spite of rounding
    mujoco.mj_forward(model, data)
    touching = {model.body(model.geom_bodyid[g]).name for c in data.contact for g in c.geom}
    odd = sorted(touching - {"world", *spec.feet})
    detail = f"expected all that touches something in the default pose; {', '.join(odd)} does, too"
    yield Check("touching in the default pose, but no foot", len(odd), 0, "", feet, detail)
    idle = sorted(set(spec.feet) - touching)
    detail = f"expected bodies on the floor in the default pose; {', '.join(idle)} is in the air"
    yield Check("feet in the air in the default pose", len(idle), 0, "", feet, detail)


def stance_checks(spec: RobotSpec, stance: Stance) -> Iterator[Check]:
    """The motors can hold the robot up in its default pose.

    A robot with a ``[gait]`` is excepted: on two small feet it has to step.
    """
    short = 0.0 if spec.gait is not None or not stance.fell else SECONDS - stance.seconds
    detail = f"expected gains that hold the default pose for {SECONDS:.0f} s; it {stance.said}"
    place = f"{spec.folder / TOML}: joints: stiffness"
    yield Check("falls in the default pose, time left", max(short, 0.0), 0.0, "s", place, detail)


def _model_checks(spec: RobotSpec) -> Iterator[Check]:
    """Every joint of the MJCF has a range and a torque, and no mesh collides."""
    lower, upper = spec.joint_limits()
    where, model = f"{spec.mjcf}: joints", spec.model()
    yield _Numbers("joints without range", where, "range", "rad").positive(spec, upper - lower)
    torque = _Numbers("joints without effort limit", where, "actuatorfrcrange", "N.m")
    yield torque.positive(spec, spec.effort_limits())
    solid = sorted({model.body(model.geom(g).bodyid[0]).name for g in colliding_meshes(model)})
    detail = f"meshes of {', '.join(solid)} collide; expected that only primitives do"
    yield Check("meshes that collide", len(solid), 0, "", str(spec.mjcf), detail)


@dataclass(frozen=True)
class _Numbers:
    """One number per joint to check: what is said of it, and where it stands."""

    name: str
    place: str
    key: str
    unit: str
    tolerance: float = 0.0

    def within(
        self,
        spec: RobotSpec,
        values: Sequence[float],
        lower: np.ndarray,
        upper: np.ndarray,
        why: str,
    ) -> Check:
        """No joint lies outside its limits; the worst is named."""
        excess = np.maximum(lower - values, np.asarray(values) - upper).clip(min=0.0)
        worst = int(excess.argmax())  # a NaN, where there is one
        low, high = f"{lower[worst]:.4g}", f"{upper[worst]:.4g}"
        expected = f"{low} to {high}" if np.isfinite(upper[worst]) else f"at least {low}"
        detail = f"expected {expected} {self.unit}, {why}; found {values[worst]:.4g}"
        return self._check(spec, worst, float(excess[worst]), self.unit, detail)

    def positive(self, spec: RobotSpec, values: Sequence[float] | np.ndarray) -> Check:
        """How many joints have none above 0; the first is named."""
        wrong = np.flatnonzero(~(np.asarray(values) > 0))
        first = int(wrong[0]) if len(wrong) else 0
        detail = f"expected a number above 0 {self.unit}; found {values[first]:.4g}"
        return self._check(spec, first, len(wrong), "", detail)

    def _check(self, spec: RobotSpec, joint: int, value: float, unit: str, detail: str) -> Check:
        detail = f"{self.key} of joint {spec.joint_names[joint]!r}: {detail}"
        return Check(self.name, value, self.tolerance, unit, self.place, detail)
