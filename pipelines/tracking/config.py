"""Configs of the tracker: its training, and what is recorded of it."""

from __future__ import annotations

from dataclasses import dataclass, field

from lacoloco.pipelines.learn.networks import NetworkConfig
from lacoloco.pipelines.learn.ppo import PpoConfig


@dataclass(frozen=True)
class TrackerConfig:
    """Training of the tracker.

    Attributes:
        worlds: Parallel worlds.
        samples: Control steps in all.
        episode_s: Length of an episode [s]. A clip that ends earlier ends it, too.
        standing_start_fraction: Share of the episodes that start in the default pose, at a moment
            of a clip slower than the robot's ``slow_speed``. Clips rarely show how a motion starts.
        stop_fraction: Share of the other episodes in which the reference changes to standing still
            at some moment. Clips rarely show how a motion stops, and never where a target is.
        stop_after_s: Earliest and latest age of the episode at that moment [s].
        grace_s: Time after a standing start or a stop without early termination [s].
        ramp: Shares of the training between which the limit on the foot forces rises to full
            strength.
        std: Exploration std at the start and at the end, in raw action units, around the inferred
            actions.
    """

    worlds: int = 512
    samples: int = 3_000_000
    episode_s: float = 4.0
    standing_start_fraction: float = 0.2
    stop_fraction: float = 0.2
    stop_after_s: tuple[float, float] = (0.3, 2.5)
    grace_s: float = 0.6
    ramp: tuple[float, float] = (0.4, 0.8)
    std: tuple[float, float] = (0.12, 0.05)
    ppo: PpoConfig = field(
        default_factory=lambda: PpoConfig(
            horizon=24,
            gamma=0.97,
            learning_rate=2e-4,
            min_learning_rate=2e-5,
            max_learning_rate=3e-3,
            desired_kl=0.02,
        )
    )
    networks: NetworkConfig = field(default_factory=NetworkConfig)


@dataclass(frozen=True)
class RecordingConfig:
    """What is recorded of a trained tracker.

    Attributes:
        copies: How often every clip is followed from its first frame, each time by a robot with
            its own friction and masses.
        starts: Number of rollouts that start in the default pose while the clip moves. Clips
            rarely show how a motion starts, and a policy that has never seen it does not start.
        start_s: Length of these rollouts [s].
        stops: Number of rollouts in which the robot moves and then stops.
        stop_after_s: Earliest and latest time of the stop [s].
        stand_s: Time that is recorded after the stop [s].
        transient_s: Time after a reset into a clip's state that is cut: the feet have not yet sunk
            into the simulated floor [s].
        before_termination_s: Time before an early termination that is cut [s].
        min_segment_s: Shorter segments are left out [s].
        rest_s: Time that is kept at either end of every rest [s]. Animals rest most of the time,
            and a policy that has seen little else stands.
    """

    copies: int = 3
    starts: int = 200
    start_s: float = 5.0
    stops: int = 200
    stop_after_s: tuple[float, float] = (0.5, 2.5)
    stand_s: float = 2.0
    transient_s: float = 0.2
    before_termination_s: float = 0.4
    min_segment_s: float = 1.0
    rest_s: float = 1.0
