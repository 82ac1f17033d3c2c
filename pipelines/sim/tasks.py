"""The four tasks, as plain data: walk, reach in place, imitate, reach. Factories take the robot;
nothing is inherited.

Numbers without a comment are the original's (facts 2.1 to 2.6); each deviation says why.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

from lacoloco.pipelines.sim.commands import Range, TargetCommand, VelocityCommand
from lacoloco.pipelines.sim.constraints import Constraint
from lacoloco.pipelines.sim.physics import CONTROL_DT
from lacoloco.pipelines.sim.randomisation import NO_RANDOMISATION, Randomisation
from lacoloco.robots.spec import RobotSpec


@dataclass(frozen=True)
class ResetConfig:
    """How an episode starts: from the default pose with these spreads, or from a frame of a
    clip.
    """

    clip_share: float = 0.0
    position: float = 0.0
    heading: float = 3.14159
    lin_vel: float = 0.3
    ang_vel: float = 0.1
    joint_scale: Range = (0.9, 1.1)


@dataclass(frozen=True)
class Task:
    """One environment's rules.

    Attributes:
        rewards: (name in ``REWARDS``, weight) pairs; their sum is multiplied by the control step,
            0.02 s.
        clip_reward: never pay less than zero, as the original's CaT environments do.
        resample_s: seconds between command changes inside an episode; None keeps one command.
        fall_on_undesired: also end the episode when an undesired body touches something.
        fall_tilt: end it also when the base is tilted by more than this [rad]. A robot that tips
            over rolls onto its back for a second before what counts as a fall touches the ground.
        noise: factor on the observation noise (0: clean).
        training_limits: motors as strong as in training rather than as strong as they are.
    """

    name: str
    action_scale: float
    command: VelocityCommand | TargetCommand | None = None
    episode_s: float = 10.0
    resample_s: Range | None = None
    rewards: tuple[tuple[str, float], ...] = ()
    clip_reward: bool = False
    constraints: tuple[Constraint, ...] = ()
    fall_on_undesired: bool = False
    fall_tilt: float | None = None
    reset: ResetConfig = field(default_factory=ResetConfig)
    randomisation: Randomisation = field(default_factory=Randomisation)
    noise: float = 1.0
    joint_pos_noise: float = 0.05
    training_limits: bool = True

    @property
    def episode_steps(self) -> int:
        """Control steps until the time-out."""
        return round(self.episode_s / CONTROL_DT)


def _solo_or(spec: RobotSpec, solo: object, other: object) -> object:
    """The quadruped's numbers for four-legged robots, the humanoid's for the rest."""
    return solo if len(spec.feet) == 4 else other


def _randomisation(spec: RobotSpec, push: float) -> Randomisation:
    # The original randomises nothing on the H1 but observations.
    return _solo_or(spec, Randomisation(push=push), NO_RANDOMISATION)


def walk_task(spec: RobotSpec) -> Task:
    """Track a planar velocity: the walking expert (facts 2.3 and 2.4).

    The style of the gait comes from the constraints on the quadruped and from penalties on the
    humanoid.
    """
    quadruped = len(spec.feet) == 4
    lateral = (-0.5, 0.5) if quadruped else (0.0, 0.0)
    forward = (-0.5, 0.5) if quadruped else (0.0, 1.0)
    constraints = (
        Constraint("torque", 3.0, 0.1),
        Constraint("joint_velocity", 16.0, 0.1),
        Constraint("joint_acceleration", 800.0, 0.1),
        Constraint("action_rate", 80.0, 0.1),
        # The original allows 50 N; the low level is held to the robot's weight, so its examples
        # should be too.
        Constraint("foot_force", spec.foot_force_limit(), 0.1),
        Constraint("base_tilt", 0.1, 0.1),
        Constraint("air_time", 0.2, 0.1),
        Constraint("stand_still", 4.0, 0.1),
        Constraint("hip_deviation", 0.2, 0.1),
    )
    penalties = (("vertical_motion", -1.0), ("tilt", -1.0), ("action_change", -0.005))
    return Task(
        name="walk",
        action_scale=spec.walk_action_scale,
        command=VelocityCommand(forward, lateral, (-0.78, 0.78)),
        episode_s=10.0,
        resample_s=(5.0, 8.0),
        rewards=(
            ("track_planar_velocity", 1.0),
            ("track_planar_velocity_closely", 0.5),
            ("track_yaw_rate", 0.5),
            *(() if quadruped else penalties),
        ),
        clip_reward=True,
        constraints=constraints if quadruped else (),
        fall_on_undesired=True,
        reset=ResetConfig(joint_scale=(0.5, 1.5)),
        randomisation=_randomisation(spec, 0.3),
        joint_pos_noise=_solo_or(spec, 0.05, 0.01),
    )


def reach_in_place_task(spec: RobotSpec) -> Task:
    """Touch points that need no step: the reaching expert (facts 2.5 and 2.6), its widest target
    box from the start.
    """
    box = _solo_or(
        spec,
        TargetCommand(x=(0.2, 0.4), y=(-0.24, 0.08), z=(0.02, 0.42)),
        TargetCommand(x=(0.4, 0.6), y=(-0.36, -0.04), z=(0.4, 1.8)),
    )
    return Task(
        name="reach_in_place",
        action_scale=spec.action_scale,
        command=box,
        resample_s=(2.0, 4.0),
        rewards=(
            ("approach", 1.0),
            ("reach", 2.0),
            ("lift", 2.0),
            ("joint_speed", -2e-4),
            ("joint_torque", -2e-3),
            ("action_change", -5e-3),
        ),
        constraints=(
            Constraint("torque", 3.0, 0.25),
            Constraint("joint_velocity", 16.0, 0.25),
            Constraint("joint_acceleration", 800.0, 0.25),
            Constraint("action_rate", 80.0, 0.25),
            Constraint("undesired_contact", 1.0, 0.25),
        )
        if len(spec.feet) == 4
        else (),
        reset=ResetConfig(heading=0.0, lin_vel=0.0, ang_vel=0.0),
        randomisation=_randomisation(spec, 0.1),
        joint_pos_noise=_solo_or(spec, 0.05, 0.01),
    )


def imitate_task(spec: RobotSpec, *, constrained: bool) -> Task:
    """The low level: no task reward; half of the episodes start inside a clip (facts 2.1)."""
    limit = spec.contact_force_limit * spec.weight()
    max_p = _solo_or(spec, 0.2, 0.1)
    return Task(
        name="imitate",
        action_scale=spec.action_scale,
        constraints=(Constraint("foot_force", limit, max_p),) if constrained else (),
        reset=ResetConfig(clip_share=0.5),
        randomisation=_randomisation(spec, 0.1),
        joint_pos_noise=_solo_or(spec, 0.05, 0.01),
    )


def reach_task(spec: RobotSpec) -> Task:
    """The paper's loco-manipulation: walk to a point and touch it (facts 2.2); one target per
    episode.
    """
    target = _solo_or(
        spec,
        TargetCommand(radius=1.5, z=(0.16, 0.42)),
        TargetCommand(x=(0.3, 4.0), y=(-1.0, 1.0), z=(1.0, 1.4)),
    )
    spread, heading = _solo_or(spec, (0.5, 3.14159), (0.0, 0.0))
    joints = _solo_or(spec, (0.75, 1.25), (1.0, 1.0))
    return Task(
        name="reach",
        action_scale=spec.action_scale,
        command=target,
        rewards=(("reach", 1.0), ("progress", 0.5)),
        reset=ResetConfig(
            position=spread, heading=heading, lin_vel=0.1, ang_vel=0.1, joint_scale=joints
        ),
        randomisation=_randomisation(spec, 0.25),
        joint_pos_noise=_solo_or(spec, 0.05, 0.01),
    )


TASKS: dict[str, Callable[..., Task]] = {
    "walk": walk_task,
    "reach_in_place": reach_in_place_task,
    "imitate": imitate_task,
    "reach": reach_task,
}
