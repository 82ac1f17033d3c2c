"""What is true of one robot and no other: numbers that trainings and metrics need."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from lacoloco.robots.tables import Angle, Length, NonNegative, Positive, Rule


@dataclass(frozen=True)
class ObservationNoise:
    """``[observation_noise]``: half-ranges of the uniform noise on a policy's view in training.

    Attributes:
        base_height: Height of the base, m.
        projected_gravity: Unit vector of gravity in the base frame.
        base_lin_vel: Linear velocity in the base frame, m/s.
        base_ang_vel: Angular velocity in the base frame, rad/s.
        joint_pos: rad.
        joint_vel: rad/s.
    """

    base_height: NonNegative = 0.0
    projected_gravity: NonNegative = 0.0
    base_lin_vel: NonNegative = 0.0
    base_ang_vel: NonNegative = 0.0
    joint_pos: NonNegative = 0.0
    joint_vel: NonNegative = 0.0


@dataclass(frozen=True)
class OdometryDrift:
    """``[odometry]``: half-ranges of the errors of the odometry that a policy without motion
    capture has, drawn anew for every episode.

    Legs and IMU of four quadrupeds came back with an error of 0.08 to 1.8 % of the way, after loops
    of 120 to 700 m (arXiv 2602.17393). The drift of the heading is assumed: that of a calibrated
    IMU is smaller.

    Attributes:
        distance: Error of a way, as a share of it, forward, sideways and up.
        heading: Error of the heading that every second adds, rad/s.
    """

    distance: Annotated[float, Rule("a number from 0, below 1", lambda x: 0 <= x < 1)] = 0.01
    heading: NonNegative = 0.001


@dataclass(frozen=True)
class SkillThresholds:
    """``[skills]``: what counts as a skill, and how near to a target is there.

    The first two are also the measure of the cells in which skills are counted: the middle one of a
    velocity reaches from -``walk_speed`` to ``walk_speed``, one of height over ``reach_height``.

    Attributes:
        walk_speed: Mean planar speed of the base from which a window counts as walking, m/s.
        reach_height: Mean height of the end effector above its height in standing from which a
            window counts as reaching, m.
        not_reached: Distance from the target beyond which an episode has not reached it, m.
        no_progress: Metres by which an episode that ends where it began may seem to have come
            nearer: how far the end effector is ahead of the base.
    """

    walk_speed: Positive
    reach_height: Length
    not_reached: Length
    no_progress: Length


@dataclass(frozen=True)
class TrackingTolerances:
    """``[tracking]``: beyond these the robot does something else than the clip.

    Attributes:
        joint_error: rms over the joints, rad.
        height_error: Of the base, m.
        tilt_error: Length of the difference of the unit vectors of gravity.
        slow_speed: Planar speed of a clip below which an episode may begin standing, m/s.
        moving_speed: Planar speed from which a clip moves, m/s.
        resting_speed: Planar speed below which a recorded robot rests, m/s.
        resting_joint_speed: Mean joint speed below which it does, rad/s.
    """

    joint_error: Positive
    height_error: Length
    tilt_error: Positive
    slow_speed: Positive
    moving_speed: Positive
    resting_speed: Positive
    resting_joint_speed: Positive


@dataclass(frozen=True)
class InverseDynamics:
    """``[inverse_dynamics]``: how joint targets are found that lead from one state to the next.

    Attributes:
        position_gain: Correction of a joint target per rad of error, rad/rad.
        velocity_gain: Correction per rad/s of error, s.
        largest_action: Largest absolute action that is taken from a clip, raw units.
    """

    position_gain: Positive
    velocity_gain: NonNegative
    largest_action: Positive


@dataclass(frozen=True)
class Terminations:
    """``[terminations]``.

    Attributes:
        training_tilt: Tilt of the base that is a fall already in training, rad. A robot that tips
            over rolls onto its back for a second before what counts as a fall touches the ground.
    """

    training_tilt: Angle


@dataclass(frozen=True)
class Gait:
    """``[gait]``: how a robot on two legs walks, for tasks that are guided by its clock.

    Attributes:
        period: Of a cycle of two steps, s.
        swing_share: Share of it that a foot is in the air; below 1/2, so that both touch between.
        lift: Height of a foot in the middle of its swing, m.
        stop_speed: Planar speed of the base below which it may stop stepping, m/s.
        stop_tilt: Length of the horizontal part of the projected gravity below which it may.
        start_speed: Speed from which a standing robot steps, m/s.
        start_tilt: Tilt from which it does.
    """

    period: Positive
    swing_share: Annotated[float, Rule("a number above 0, below 1/2", lambda x: 0 < x < 0.5)]
    lift: Length
    stop_speed: Positive
    stop_tilt: Positive
    start_speed: Positive
    start_tilt: Positive
