"""What a robot is: its MJCF, plus the numbers MJCF has no place for."""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from lacoloco.robots import mjcf
from lacoloco.robots.numbers import (
    Gait,
    InverseDynamics,
    ObservationNoise,
    OdometryDrift,
    SkillThresholds,
    Terminations,
    TrackingTolerances,
)

if TYPE_CHECKING:
    import mujoco
    import pinocchio


@dataclass(frozen=True)
class EndEffector:
    """The point that reaches for targets.

    Attributes:
        body: Body of the MJCF that carries it.
        offset: Position in the frame of that body, metres.
    """

    body: str
    offset: tuple[float, float, float] = (0.0, 0.0, 0.0)


@dataclass(frozen=True)
class RobotSpec:
    """One robot. Joint tuples have one entry per joint, in the order of ``joint_names``.

    Attributes:
        name: Its name, by which artifacts know it.
        folder: Folder that it was read from; it may be gone by now.
        mjcf_name: Name of its MJCF, the only source of frames, masses, ranges and efforts.
        sources: (name, text) of robot.toml and of the MJCF, as they were read.
        joint_names: Order of the MJCF and of Pinocchio, and of every joint vector in the project.
        default_joint_pos: Default pose, rad; actions are offsets from it.
        stiffness: Proportional gains, N.m/rad.
        damping: Derivative gains, N.m.s/rad.
        action_scale: Radians per unit of action (low level, reaching).
        walk_action_scale: Radians per unit of action of the walking expert.
        training_effort_limits: Torque limits while training, N.m. Evaluation uses those of the
            MJCF (``effort_limits``).
        velocity_limits: Speed limits of the motors, rad/s. MuJoCo does not enforce them: they
            serve rewards, constraints and checks.
        end_effector: The point that reaches for targets.
        feet: Bodies that may touch the ground.
        fall_bodies: Bodies whose contact (> 1 N) is a fall.
        undesired_contact_bodies: Bodies whose contact is a mistake but not a fall.
        contact_force_limit: Limit of the force on one foot, in multiples of ``weight()``.
        self_collision: Whether the robot's own bodies collide with each other.
        keypoints: Mocap joint -> body of this robot, for retargeting; empty if unused.
        retarget_neutral: Joint pose the retargeting is drawn to, rad.
        retarget_lower: Lower joint bounds of the retargeting, rad.
        retarget_upper: Upper joint bounds of the retargeting, rad.
        knee_frames: Bodies whose origin the retargeting keeps above the ground.
        points: Name -> point of a body that can follow a joint of a recording as bodies can.
        soles: Foot -> the two points that it stands on, its heel and its toes; a foot that is
            missing stands on its origin.
        abduction_joints: Joints that move a leg sideways.
        observation_noise: Noise on a policy's view in training.
        odometry: Errors of the odometry of a policy without motion capture.
        skills: What counts as a skill, and how near to a target is there.
        tracking: What a tracker may be off by.
        inverse_dynamics: How actions of clips are found.
        terminations: What ends an episode in training besides a fall.
        gait: How it walks, if it walks on two legs by a clock.
        tasks: Name -> table of the task, as :mod:`lacoloco.pipelines.sim.tasks` reads it.
    """

    name: str
    folder: Path
    mjcf_name: str
    sources: tuple[tuple[str, str], ...] = field(repr=False)
    joint_names: tuple[str, ...]
    default_joint_pos: tuple[float, ...]
    stiffness: tuple[float, ...]
    damping: tuple[float, ...]
    action_scale: float
    walk_action_scale: float
    training_effort_limits: tuple[float, ...]
    velocity_limits: tuple[float, ...]
    end_effector: EndEffector
    feet: tuple[str, ...]
    fall_bodies: tuple[str, ...]
    undesired_contact_bodies: tuple[str, ...]
    contact_force_limit: float
    self_collision: bool
    retarget_neutral: tuple[float, ...]
    retarget_lower: tuple[float, ...]
    retarget_upper: tuple[float, ...]
    knee_frames: tuple[str, ...]
    abduction_joints: tuple[str, ...]
    observation_noise: ObservationNoise
    odometry: OdometryDrift
    skills: SkillThresholds
    tracking: TrackingTolerances
    inverse_dynamics: InverseDynamics
    terminations: Terminations
    gait: Gait | None = None
    tasks: Mapping[str, Any] = field(default_factory=dict, hash=False, compare=False, repr=False)
    keypoints: Mapping[str, str] = field(default_factory=dict, hash=False)
    points: Mapping[str, EndEffector] = field(default_factory=dict, hash=False)
    soles: Mapping[str, tuple[str, ...]] = field(default_factory=dict, hash=False)

    @property
    def num_joints(self) -> int:
        """Number of actuated joints J (Solo12: 12, H1: 19)."""
        return len(self.joint_names)

    @property
    def contact_bodies(self) -> tuple[str, ...]:
        """Bodies with a ``force_<body>`` sensor: feet, fall bodies, undesired ones, in order."""
        return tuple(dict.fromkeys((*self.feet, *self.fall_bodies, *self.undesired_contact_bodies)))

    @property
    def foot_points(self) -> tuple[str, ...]:
        """What the feet stand on, P bodies or points in the order of the feet: heel before toes."""
        return tuple(point for foot in self.feet for point in self.soles.get(foot, (foot,)))

    @property
    def foot_of_point(self) -> tuple[int, ...]:
        """Index of the foot that each of the P ``foot_points`` belongs to."""
        return tuple(
            index for index, foot in enumerate(self.feet) for _ in self.soles.get(foot, (foot,))
        )

    def located(self, names: Iterable[str]) -> tuple[list[str], list[tuple[float, float, float]]]:
        """Bodies, and positions in their frames [m], of bodies and ``points`` by name."""
        points = [self.points.get(name, EndEffector(name)) for name in names]
        return [point.body for point in points], [point.offset for point in points]

    @property
    def mjcf(self) -> Path:
        """Where the MJCF was read from."""
        return self.folder / self.mjcf_name

    def files(self) -> dict[str, str]:
        """Name -> text of robot.toml and the MJCF: all that
        :func:`lacoloco.robots.loading.robot_from_files` needs, wherever the folder is.
        """
        return dict(self.sources)

    def model(self) -> mujoco.MjModel:
        """The bare robot in MuJoCo: no floor, no actuators. Shared: read it, do not write to it.

        Raises:
            RobotError: MuJoCo cannot compile it.
        """
        return mjcf.bare_model(self._mjcf_text, self.mjcf)

    def editable_model(self) -> mujoco.MjSpec:
        """The bare robot as a new MuJoCo spec, to which a scene can be added.

        Raises:
            RobotError: MuJoCo cannot read it.
        """
        return mjcf.parse(self._mjcf_text, self.mjcf)

    def pinocchio_model(self) -> pinocchio.Model:
        """A new Pinocchio model of the same MJCF (nq = 7 + J, quaternion xyzw)."""
        return mjcf.pinocchio_model(self._mjcf_text, self.mjcf)

    def model_hash(self) -> str:
        """SHA-256 of the MJCF's bytes, hexadecimal: what artifacts record as provenance."""
        return hashlib.sha256(self._mjcf_text.encode()).hexdigest()

    @property
    def _mjcf_text(self) -> str:
        return self.files()[self.mjcf_name]

    def total_mass(self) -> float:
        """Mass of the whole robot, kg."""
        return float(self.model().body_mass.sum())

    def weight(self) -> float:
        """Total mass times gravity, N."""
        return self.total_mass() * float(np.linalg.norm(self.model().opt.gravity))

    def foot_force_limit(self) -> float:
        """Limit of the contact force on one foot, N: ``contact_force_limit * weight()``."""
        return self.contact_force_limit * self.weight()

    def effort_limits(self) -> np.ndarray:
        """Torque limits of the motors, (J,), N.m, from ``actuatorfrcrange``."""
        return self.model().jnt_actfrcrange[1:, 1].copy()

    def joint_limits(self) -> tuple[np.ndarray, np.ndarray]:
        """Lower and upper joint limits, (J,) each, rad, from ``range``."""
        limits = self.model().jnt_range[1:]
        return limits[:, 0].copy(), limits[:, 1].copy()

    def default_height(self) -> float:
        """Height of the base with the feet just touching the floor in the default pose, m."""
        from lacoloco.robots.geometry import standing_height

        return standing_height(self.model(), np.asarray(self.default_joint_pos), self.feet)

    def default_qpos(self) -> np.ndarray:
        """Default pose on the floor in MuJoCo's order, (7 + J,): xyz, wxyz, joints."""
        base = [0.0, 0.0, self.default_height(), 1.0, 0.0, 0.0, 0.0]
        return np.concatenate([base, self.default_joint_pos])

    def foot_radius(self) -> float:
        """Radius of the (sphere or capsule) geoms of the feet, m."""
        from lacoloco.robots.geometry import foot_radius

        return foot_radius(self.model(), self.feet)
