"""Settings of low-level training."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Annotated, Literal

from lacoloco.datasets.config_values import (
    Anneal,
    Length,
    Ramp,
    Rising,
    Share,
    Std,
    Steps,
    Text,
    Within,
    Worlds,
)
from lacoloco.pipelines.learn.ase import AseConfig
from lacoloco.pipelines.learn.cat import Scale
from lacoloco.pipelines.learn.latents import LatentConfig
from lacoloco.pipelines.learn.networks import NetworkConfig
from lacoloco.pipelines.learn.ppo import PpoConfig
from lacoloco.pipelines.learn.skill_embedding import WindowConfig
from lacoloco.pipelines.sim.observation import ObservationConfig


@dataclass(frozen=True)
class TrainLowConfig:
    """Low-level training.

    Attributes:
        worlds: Parallel worlds.
        samples: Control steps of the whole training, over all worlds.
        cat: Constrain the foot forces (Constraints as Terminations).
        cat_ramp: Shares of the training between which the constraint rises to full strength.
        cat_scale: What the worst violation of a step is compared with, c_max: a running mean of the
            violations, or the largest of the last rollout, as in the paper.
        clip_share: Share of resets that start inside a clip.
        episode_s: Time-out of an episode [s]. The original's code has 10 s. A policy that cannot
            walk yet leaves a clip's motion within tenths of a second, and learns to stay in it
            longer only just after a reset.
        long_horizon_fraction: Share of the worlds with long-horizon episodes: 10 s from a standing
            start, with latents that follow a random walk, as under a high level.
        long_horizon_from: Share of the training after which these worlds have them. An untrained
            policy that falls at every change of latent learns to stand.
        randomisation: Factor on the spread of masses, centres of mass and friction; evaluation has
            a factor of 1.
        restart_probability: Share of falls after which a world restarts from a snapshot of up to
            1 s before.
        push: Largest change of velocity by a push, where the task has pushes [m/s, rad/s];
            evaluation has 0.25.
        push_every_s: Shortest and longest time between two pushes [s].
        exploration_std: Standard deviation of the exploration noise [raw action units; times the
            action scale: rad].
        kl_anneal: What the KL target falls to, as a share of itself, and the shares of the training
            between which it falls. With a constant KL target the skills do not settle: 94 % of the
            latents walk, and half a million samples later 27 %.
        bc_steps: Gradient steps of behaviour-cloning pretraining on actions inferred from the
            clips. 0 starts from a random network and latents without a meaning, as in the paper.
        bc_clip_start_fraction: Share of the cloned windows that start where a clip starts. All
            tasks of a high level start from standing, and clips rarely show that.
        expert_rounds: Rounds in which the cloned policy performs the clips by itself, the experts
            that made them say what they would do there, and all of it is cloned again. Half of
            ``bc_steps`` come before each round, twice as many after the last. None: 7 for a robot
            with a gait whose clips say what their expert was commanded, 0 for others.
        expert_worlds: Worlds per expert and round.
        latent_noise: Largest standard deviation of the noise on the latents of those rounds. A high
            level also chooses latents that no clip has.
        critic_warmup: Share of the training in which critic, discriminator and encoder learn, but
            not the actor. The first advantages of an untrained critic would undo the pretraining.
        windows: What a latent describes while the clips are cloned.
        skill_shares: Pairs of a skill's name and its share of demonstrations and of resets into
            clips. Empty: by duration.
        cell_balance: How evenly demonstrations, cloned windows and resets are drawn over the cells
            of velocity and end-effector height that the clips of a skill show: 0 as often as they
            show them, 1 all cells alike. Each skill is drawn as often as without.
        coverage_every: Control steps between two measurements of the skill coverage. 0: only at the
            end.
        coverage_latents: Latents held in each measurement.
        choose_from: Share of the training after which a measured policy may become the one that is
            kept. The constraint should be at full strength by then.
        shift: "hardware": worlds differ by what ``lacoloco eval --shift hardware`` adds: latency,
            joint friction, slope and the like, each to a degree of its own. "": as usual.
        observation: What the policy and its critic observe.
        latents: How latents are sampled.
        ppo: Optimisation of actor and critic.
        networks: Actor and critic.
        ase: Discriminator and encoder.
    """

    worlds: Worlds = 512
    samples: Steps = 6_000_000
    cat: bool = True
    cat_ramp: Ramp = (0.3, 0.5)
    cat_scale: Scale = "mean"
    clip_share: Share = 0.7
    episode_s: Annotated[float, Within(0.02, 3600)] = 2.0
    long_horizon_fraction: Share = 0.5
    long_horizon_from: Share = 0.3
    randomisation: Annotated[float, Within(0, 10)] = 1.5
    restart_probability: Share = 0.9
    push: Annotated[float, Within(0, 10)] = 0.3
    push_every_s: Annotated[tuple[float, float], Within(0.02, 3600), Rising()] = (1.0, 3.0)
    exploration_std: Std = 0.05
    kl_anneal: Anneal = (0.1, 0.6, 1.0)
    bc_steps: Annotated[int, Within(0, 10**7)] = 3000
    bc_clip_start_fraction: Share = 0.2
    expert_rounds: Annotated[int, Within(0, 1000)] | None = None
    expert_worlds: Worlds = 256
    latent_noise: Share = 0.5
    critic_warmup: Share = 0.03
    windows: WindowConfig = field(default_factory=WindowConfig)
    skill_shares: Annotated[tuple[tuple[Text, Share], ...], Length(0, 1000)] = ()
    cell_balance: Share = 0.0
    coverage_every: Annotated[int, Within(0, 10**12)] = 250_000
    coverage_latents: Annotated[int, Within(1, 131_072)] = 256
    choose_from: Share = 0.8
    shift: Literal["", "hardware"] = ""
    observation: ObservationConfig = field(default_factory=ObservationConfig)
    latents: LatentConfig = field(default_factory=LatentConfig)
    ppo: PpoConfig = field(
        default_factory=lambda: PpoConfig(
            horizon=16,
            epochs=4,
            minibatches=2,
            gamma=0.98,
            desired_kl=0.02,
            learning_rate=5e-5,
            min_learning_rate=1e-6,
        )
    )
    networks: NetworkConfig = field(default_factory=NetworkConfig)
    ase: AseConfig = field(default_factory=AseConfig)

    def conflict(self) -> str:
        """What does not fit together, "" if all does."""
        if self.ase.label_weight and not (self.bc_steps and self.expert_rounds != 0):
            return (
                f"ase.label_weight={self.ase.label_weight}: no expert is asked; use 0, or more than"
                " 0 of bc_steps and expert_rounds"
            )
        return self.ppo.conflict_with(self.worlds)
