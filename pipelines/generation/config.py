"""Configs of the stage generate: the training of the experts, and what is recorded of them."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Annotated

from lacoloco.datasets.config_values import Factor, PositiveFactor, Ramp, Steps, Within, Worlds
from lacoloco.pipelines.learn.networks import NetworkConfig
from lacoloco.pipelines.learn.ppo import PpoConfig


@dataclass(frozen=True)
class ExpertConfig:
    """Training of one expert.

    Attributes:
        worlds: Parallel worlds.
        samples: Control steps in all.
        reward_scale: Factor on the task's reward, so that returns are near 1.
        ramp: Shares of the training between which the constraints rise from nothing to full
            strength.
        std: Exploration std at the start and at the end, in raw action units. On a schedule: a
            learned one collapses within a million samples, long before the foot has found its
            target.
    """

    worlds: Worlds = 512
    samples: Steps = 2_500_000
    reward_scale: PositiveFactor = 3.0
    ramp: Ramp = (0.05, 0.6)
    std: Annotated[tuple[float, float], Within(0, 100, above=True)] = (0.5, 0.15)
    ppo: PpoConfig = field(
        default_factory=lambda: PpoConfig(
            horizon=24,
            learning_rate=2e-4,
            min_learning_rate=5e-5,
            max_learning_rate=3e-3,
            desired_kl=0.02,
        )
    )
    networks: NetworkConfig = field(default_factory=NetworkConfig)

    def conflict(self) -> str:
        """What does not fit together, "" if all does."""
        return self.ppo.conflict_with(self.worlds)


def reach_expert() -> ExpertConfig:
    """Less noise for the larger action scale of reaching."""
    return ExpertConfig(std=(0.25, 0.1))


def wide(expert: ExpertConfig, iterations: int) -> ExpertConfig:
    """An expert's recipe on a GPU's width, for so many iterations of 4096 worlds."""
    ppo = replace(expert.ppo, minibatches=6)
    return replace(expert, worlds=4096, samples=iterations * ppo.horizon * 4096, ppo=ppo)


def smoke_expert() -> ExpertConfig:
    """Two iterations of a tiny network."""
    return ExpertConfig(
        worlds=16,
        samples=16 * 4 * 2,
        ppo=PpoConfig(horizon=4, epochs=1, minibatches=2),
        networks=NetworkConfig(actor=(32,), critic=(32,)),
    )


@dataclass(frozen=True)
class GenerateConfig:
    """Experts and recording.

    Attributes:
        walk_clips: Number of walking clips (paper: 120).
        reach_clips: Number of reaching clips (paper: 20).
        reach_weight: How often a moment of reaching is sampled for one of walking. At 1
            one sampled moment in seven shows reaching, at 4 two in five, at 9 three in five. A low
            level ends up showing it a third as often as its clips do.
        seconds: Length of a clip.
        episodes: Episodes that a newly trained expert is assessed in, with its task's pushes and
            motors as strong as they are.
        transient_s: Seconds from the start of a clip that do not count in the tracking errors.
    """

    walk: ExpertConfig = field(default_factory=lambda: ExpertConfig(samples=3_000_000))
    reach: ExpertConfig = field(default_factory=reach_expert)
    walk_clips: Annotated[int, Within(0, 100_000)] = 120
    reach_clips: Annotated[int, Within(0, 100_000)] = 20
    reach_weight: Factor = 9.0
    seconds: Annotated[float, Within(0.1, 600)] = 10.0
    episodes: Annotated[int, Within(1, 100_000)] = 192
    transient_s: Annotated[float, Within(0, 600)] = 1.0

    def conflict(self) -> str:
        """What does not fit together, "" if all does."""
        if not self.walk_clips + self.reach_clips:
            return "walk_clips=0: use at least 1, or at least 1 of reach_clips"
        if self.transient_s >= self.seconds:
            return f"transient_s={self.transient_s}: use less than seconds = {self.seconds}"
        return ""
