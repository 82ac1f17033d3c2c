"""Settings of high-level training."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Annotated, Literal

from lacoloco.datasets.config_values import (
    Anneal,
    Factor,
    PositiveFactor,
    Ramp,
    Rising,
    Share,
    Steps,
    Within,
    Worlds,
)
from lacoloco.pipelines.learn.networks import NetworkConfig
from lacoloco.pipelines.learn.ppo import PpoConfig
from lacoloco.pipelines.sim.observation import ObservationConfig

CONTACT_FORCE_PENALTY = 4.0
"""Default over a constrained low level. A penalty of 10 from the start removed four fifths of the
violations, but learning was much slower: 39 cm instead of 15 cm after 0.9 M decisions.
"""


@dataclass(frozen=True)
class SkillDynamicsConfig:
    """Pretraining: what latents do is learned, and a policy made from it.

    Attributes:
        rounds: How often latents are tried. From the second on the policy of before steers half of
            the time, so that they are tried where it brings the robot. 0 starts from a random
            network.
        decisions: Decisions per world in a round. The first answer of a latent comes after three.
        hold: Fewest and most decisions for which a latent is held.
        near_share: Share of the latents that lie around the policy's own, from the second round on.
            Where one of a thousand latents is right, uniform ones hardly say which.
        near_spread: Largest standard deviation of the noise between those and the policy's own, see
            :func:`~lacoloco.pipelines.learn.latents.scatter`.
        model_steps: Gradient steps of what predicts, in a round.
        policy_steps: Gradient steps of the policy, in a round.
        batch: Decisions per gradient step.
    """

    rounds: Annotated[int, Within(0, 1000)] = 2
    decisions: Annotated[int, Within(4, 100_000)] = 100
    hold: Annotated[tuple[int, int], Within(4, 100_000), Rising()] = (5, 25)
    near_share: Share = 0.7
    near_spread: Annotated[float, Within(0, 10)] = 0.25
    model_steps: Annotated[int, Within(1, 10**7)] = 2000
    policy_steps: Annotated[int, Within(1, 10**7)] = 1500
    batch: Annotated[int, Within(1, 2**20)] = 2048


@dataclass(frozen=True)
class TrainHighConfig:
    """High-level training.

    Attributes:
        worlds: Parallel worlds.
        decisions: Decisions of the whole training, over all worlds; each takes five control steps.
        std: Standard deviation of the exploration noise on the unnormalised latent, at the start
            and at the end. High-noise phases keep the first value.
        kl_anneal: What the KL target falls to, as a share of itself, and the shares of the training
            between which it falls.
        skill_dynamics: Pretraining on what random latents do.
        critic_warmup: Share of the training in which only the critic learns.
        reward_scale: Factor on the task's reward.
        shaped: Whether a task's reward for progress towards its target counts. The paper has none.
        fall_penalty: Taken from the scaled reward by a fall. The lost future alone is worth little
            far from the target, where most falls happen.
        contact_force_penalty: Taken from the scaled reward, per share of the foot-substeps above
            the limit on the contact force. None: 4 over a low level trained with the constraint, 0
            over another. Nine tenths of the violations of a constrained low level come from going
            faster than 0.5 m/s.
        contact_force_penalty_ramp: Shares of the training between which that penalty rises from 0.
        near_target_fraction: Share of the targets that are nearer than the task's. On the way to a
            far target little of an episode is left to learn to touch it.
        noise_free_fraction: Share of the worlds without observation noise. Noise always moves the
            robot a little. Without it, as in evaluation, a policy that answers standing with a
            latent that stands never leaves it.
        randomisation: Factor on the spread of masses, centres of mass, friction and pushes;
            evaluation has a factor of 1.
        stood_s: Shortest and longest time for which the robot has stood in the default pose before
            an episode begins [s]; evaluation has 0.
        restart_probability: Share of falls after which a world restarts from a snapshot of up to
            1 s before, and share of failed episodes that are replayed from their start with the
            same target.
        replay_failed_from: Share of the training after which failed episodes are replayed. Before
            it nearly all episodes fail.
        shift: "hardware": worlds differ by what ``lacoloco eval --shift hardware`` adds: latency,
            joint friction, slope and the like, each to a degree of its own. "": as usual.
        observation: What the policy and its critic observe.
        ppo: Optimisation of actor and critic.
        networks: Actor and critic.
    """

    worlds: Worlds = 512
    decisions: Steps = 4_000_000
    std: Annotated[tuple[float, float], Within(0, 100, above=True)] = (0.5, 0.12)
    kl_anneal: Anneal = (0.1, 0.6, 1.0)
    skill_dynamics: SkillDynamicsConfig = field(default_factory=SkillDynamicsConfig)
    critic_warmup: Share = 0.02
    reward_scale: PositiveFactor = 10.0
    shaped: bool = True
    fall_penalty: Factor = 2.0
    contact_force_penalty: Factor | None = None
    contact_force_penalty_ramp: Ramp = (0.2, 0.5)
    near_target_fraction: Share = 0.5
    noise_free_fraction: Share = 0.5
    randomisation: Annotated[float, Within(0, 10)] = 1.25
    stood_s: Annotated[tuple[float, float], Within(0, 10), Rising()] = (0.0, 0.0)
    restart_probability: Share = 0.9
    replay_failed_from: Share = 0.4
    shift: Literal["", "hardware"] = ""
    observation: ObservationConfig = field(default_factory=ObservationConfig)
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
            greedy_fraction=0.4,
            noise_hold_steps=10.0,
            high_noise_fraction=0.15,
        )
    )
    networks: NetworkConfig = field(
        default_factory=lambda: NetworkConfig(
            actor=(256, 128), critic=(256, 128), activation="relu"
        )
    )

    def conflict(self) -> str:
        """What does not fit together, "" if all does."""
        return self.ppo.conflict_with(self.worlds)
