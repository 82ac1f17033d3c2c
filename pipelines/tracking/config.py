"""Configs of the tracker: its training, and what is recorded of it."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Annotated

from lacoloco.datasets.config_values import Ramp, Rising, Seconds, Share, Steps, Within, Worlds
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

    worlds: Worlds = 512
    samples: Steps = 3_000_000
    episode_s: Annotated[float, Within(0.02, 3600)] = 4.0
    standing_start_fraction: Share = 0.2
    stop_fraction: Share = 0.2
    stop_after_s: Annotated[tuple[float, float], Within(0, 3600), Rising()] = (0.3, 2.5)
    grace_s: Seconds = 0.6
    ramp: Ramp = (0.4, 0.8)
    std: Annotated[tuple[float, float], Within(0, 100, above=True)] = (0.12, 0.05)
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

    def conflict(self) -> str:
        """What does not fit together, "" if all does."""
        return self.ppo.conflict_with(self.worlds)


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

    copies: Annotated[int, Within(1, 10_000)] = 3
    starts: Annotated[int, Within(0, 131_072)] = 200
    start_s: Annotated[float, Within(0.02, 3600)] = 5.0
    stops: Annotated[int, Within(0, 131_072)] = 200
    stop_after_s: Annotated[tuple[float, float], Within(0, 3600), Rising()] = (0.5, 2.5)
    stand_s: Seconds = 2.0
    transient_s: Seconds = 0.2
    before_termination_s: Seconds = 0.4
    min_segment_s: Annotated[float, Within(0.04, 3600)] = 1.0
    rest_s: Seconds = 1.0
