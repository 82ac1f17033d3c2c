"""Which disturbances a task has; by default none."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Annotated

from lacoloco.robots.tables import NonNegative, Range, Rule, Share

Substeps = Annotated[int, Rule("a whole number from 6 to 40", lambda x: 6 <= x <= 40)]
Cone = Annotated[str, Rule("pyramidal or elliptic", lambda x: x in ("pyramidal", "elliptic"))]
Solver = Annotated[str, Rule("newton or pgs", lambda x: x in ("newton", "pgs"))]
Engine = Annotated[str, Rule("warp or nothing", lambda x: x in ("", "warp"))]
Factor = Annotated[float, Rule("a number above 0, at most 1", lambda x: 0 < x <= 1)]


@dataclass(frozen=True)
class Disturbances:
    """What differs from the simulation that policies are trained in. Draws have a generator of
    their own, so that episodes of one seed stay the same episodes.

    Attributes:
        noise: Factor on the robot's observation noise, as in training.
        action_latency: Mean time until the motors have a new target [s].
        observation_latency: Mean age of what the policy sees [s].
        latency_jitter: Half-range of both, as a share; drawn anew in every control step.
        joint_offset: Half-range of the encoders' errors, one per joint and world [rad].
        gain_error: Half-range of the factors on both gains of every motor, around 1.
        torque_speed: Torque falls from half the speed limit on, to none at the limit.
        joint_friction: Dry friction of the joints, as a share of the torque limit.
        joint_damping: Damping of the joints, as a share of the motor's own.
        explicit_pd: Gains act on the state at the beginning of a physics step, as a motor board
            computes them; MuJoCo integrates their damping implicitly.
        substeps: Physics steps in a control step of 20 ms.
        contact_time: Time constant of contacts [s]; 0: as usual.
        mocap_filter: Time constant of the low-pass on the base's position and velocity [s].
        mocap_delay: Age of them beyond the observation's [s], drawn in every control step.
        mocap_dropout: How long they stay as they were when the motion capture loses the robot [s].
        mocap_dropout_interval: Mean time between two losses [s].
        slippery_foot: Factor on the friction of one foot, another one in every world.
        floor_tilt: Slope of the floor, in a direction of its own in every world [rad]. Positions
            are those over the floor.
        floor_steps: Height of steps, strips 30 cm wide that are up and down by turns [m].
        payload: Half-range of the mass added to the base, as a share of the robot's.
        payload_place: Half-ranges, forward and to the side, of where it sits [m].
        cone: Friction cones of MuJoCo.
        solver: Solver of MuJoCo.
        engine: Other physics engine, which takes no other disturbance than those of the sensors.
        graded: Each world has its own share, from none to all, of both latencies, of the joints'
            friction and damping, of the slope and of the height of steps; half of them have
            elliptic cones. For training: a policy meets the mild cases, too.
    """

    noise: NonNegative = 0.0
    action_latency: NonNegative = 0.0
    observation_latency: NonNegative = 0.0
    latency_jitter: Share = 0.0
    joint_offset: NonNegative = 0.0
    gain_error: Share = 0.0
    torque_speed: bool = False
    joint_friction: NonNegative = 0.0
    joint_damping: NonNegative = 0.0
    explicit_pd: bool = False
    substeps: Substeps = 6
    contact_time: NonNegative = 0.0
    mocap_filter: NonNegative = 0.0
    mocap_delay: Range = (0.0, 0.0)
    mocap_dropout: NonNegative = 0.0
    mocap_dropout_interval: NonNegative = 1.0
    slippery_foot: Factor = 1.0
    floor_tilt: NonNegative = 0.0
    floor_steps: NonNegative = 0.0
    payload: Share = 0.0
    payload_place: tuple[float, float] = (0.1, 0.05)
    cone: Cone = "pyramidal"
    solver: Solver = "newton"
    engine: Engine = ""
    graded: bool = False

    @property
    def of_sensors(self) -> bool:
        """Whether the policy sees something else than the state."""
        return self.noise > 0.0 or self.of_readings

    @property
    def of_readings(self) -> bool:
        """Whether readings are late, filtered, lost or off, noise aside."""
        times = (self.observation_latency, self.mocap_filter, *self.mocap_delay)
        return any((*times, self.mocap_dropout, self.joint_offset, self.floor_tilt))

    @property
    def of_physics(self) -> bool:
        """Whether the physics differ; late readings need its record of substeps, too."""
        seen = {
            **{"noise": 0.0, "latency_jitter": 0.0, "mocap_dropout_interval": 1.0},
            **{"engine": "", "graded": False},
        }
        return replace(self, **seen) != UNDISTURBED  # type: ignore[arg-type]


UNDISTURBED = Disturbances()
