"""What a high level's training is told."""

from __future__ import annotations

from dataclasses import dataclass, field

from lacoloco.pipelines.high_level.hindsight import HindsightConfig
from lacoloco.pipelines.learn.networks import NetworkConfig
from lacoloco.pipelines.learn.ppo import PpoConfig

PRICE = 4.0
"""Ten from the start on made four fifths of the violations go, and learning two thirds slower: 39
instead of 15 cm after 0.9 M decisions.
"""


@dataclass(frozen=True)
class TrainHighConfig:
    """High-level training.

    Attributes:
        worlds: parallel worlds.
        decisions: high-level samples in all; each takes five control steps.
        std: exploration std of the unnormalised latent at the start and at the end; bold spells
            keep that of the start.
        settle: what the KL target falls to, as a share of itself, and the shares of the training
            between which it does.
        hindsight: what it begins with: random latents and where they led.
        head_start: share of the training in which the critic learns alone.
        reward_scale: factor on the task's reward.
        fall_penalty: taken from the scaled reward by a fall. The lost future alone is worth little
            far from the target, where most falls happen: in the first two seconds, while turning
            towards it.
        force_price: taken from the scaled reward per share of the foot-substeps above the limit on
            the contact force; None for ``PRICE`` over a low level that was constrained and nothing
            over another. Nine tenths of the violations that a constrained low level is left with
            are made by going faster than half a metre per second.
        price_ramp: shares of the training between which that price rises from nothing.
        near: share of the training's targets that lie nearer than the task's; the way there takes
            most of an episode, and only what is left of it teaches how to touch.
        clean: share of the worlds without observation noise. Under noise nothing ever stands quite
            still; without it, as in evaluation, a policy that answers standing with a latent that
            stands is caught for good.
        randomisation: factor on the spread of masses, centres of mass, friction and pushes;
            evaluation is at 1.
        second_chances: share of falls after which the world is put back to shortly before, again
            and again, and of misses after which it is put back to where the episode began, with the
            same target.
        rematch_from: share of the training from which on that holds for misses; before it nearly
            everybody misses.
    """

    worlds: int = 512
    decisions: int = 4_000_000
    std: tuple[float, float] = (0.5, 0.12)
    settle: tuple[float, float, float] = (0.1, 0.6, 1.0)
    hindsight: HindsightConfig = field(default_factory=HindsightConfig)
    head_start: float = 0.02
    reward_scale: float = 10.0
    fall_penalty: float = 2.0
    force_price: float | None = None
    price_ramp: tuple[float, float] = (0.2, 0.5)
    near: float = 0.5
    clean: float = 0.5
    randomisation: float = 1.25
    second_chances: float = 0.9
    rematch_from: float = 0.4
    ppo: PpoConfig = field(
        default_factory=lambda: PpoConfig(
            horizon=8,
            epochs=5,
            minibatches=2,
            gamma=0.97,
            desired_kl=0.02,
            min_learning_rate=1e-6,
            bound=1.5,
            bound_weight=0.1,
            deterministic_share=0.4,
            spell=10.0,
            bold_share=0.15,
        )
    )
    networks: NetworkConfig = field(
        default_factory=lambda: NetworkConfig(
            actor=(256, 128), critic=(256, 128), activation="relu"
        )
    )
