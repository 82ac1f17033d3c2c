"""The paper's low-level training without what this project adds to it.

Values are those of the paper's code where the text has none. What they cannot say is in
``learn/README.md``.
"""

from __future__ import annotations

from math import exp

from lacoloco.pipelines.learn.ase import AseConfig
from lacoloco.pipelines.learn.drail import DrailConfig
from lacoloco.pipelines.learn.gan import GanConfig
from lacoloco.pipelines.learn.networks import NetworkConfig
from lacoloco.pipelines.learn.ppo import PpoConfig
from lacoloco.pipelines.low_level.config import TrainLowConfig

RATE = 2e-5
"""Of actor, critic, discriminator and encoder."""
TRUNK = (1024, 1024, 512)
"""Hidden layers of the GAN discriminator, and of the encoder."""
STD = exp(-2.9)


def paper_method() -> TrainLowConfig:
    """An eighth of the paper's worlds and batches, so that a rollout has as many updates."""
    return TrainLowConfig(
        worlds=512,
        samples=10_000_000,
        cat_ramp=(5000 / 7000, 5937.5 / 7000),
        cat_scale="maximum",
        clip_share=0.5,
        episode_s=10.0,
        long_horizon_fraction=0.0,
        long_horizon_from=1.0,
        randomisation=1.0,
        restart_probability=0.0,
        push=0.1,
        push_every_s=(5.0, 8.0),
        exploration_std=STD,
        kl_anneal=(1.0, 0.0, 1.0),
        bc_steps=0,
        expert_rounds=0,
        critic_warmup=0.0,
        coverage_every=1_000_000,
        choose_from=1.0,
        ppo=ppo(bound_weight=10.0, greedy_fraction=0.1),
        networks=NetworkConfig(
            actor=(512, 256, 128),
            critic=(512, 256, 128),
            activation="relu",
            init_std=STD,
            learn_std=True,
            style=(512, 256),
        ),
        ase=_adversary(),
    )


def ppo(*, bound_weight: float = 0.0, greedy_fraction: float = 0.0) -> PpoConfig:
    """PPO of both levels: a fixed rate, and no limit on gradients."""
    return PpoConfig(
        horizon=32,
        epochs=6,
        minibatches=8,
        gamma=0.99,
        lam=0.95,
        clip=0.2,
        learning_rate=RATE,
        min_learning_rate=RATE,
        max_learning_rate=RATE,
        critic_learning_rate=RATE,
        max_grad_norm=1e6,
        bound=1.1,
        bound_weight=bound_weight,
        greedy_fraction=greedy_fraction,
    )


def _adversary() -> AseConfig:
    """Discriminator and encoder: a gradient step with each one of PPO's."""
    return AseConfig(
        gan=GanConfig(
            hidden=TRUNK,
            activation="relu",
            encoder_shares=True,
            noise=0.0,
            samples=1,
            gradient_penalty=5.0,
            logit_decay=0.01,
            max_accuracy=1.0,
        ),
        drail=DrailConfig(
            hidden=256, layers=4, samples=1, times=(0.0, 1.0), scale=1.0, max_accuracy=1.0
        ),
        encoder_hidden=TRUNK,
        encoder_activation="relu",
        encoder_weight=0.5,
        reward_ceiling=9.21,
        updates=6 * 8,
        batch=1024,
        learning_rate=RATE,
        encoder_learning_rate=RATE,
        replay_capacity=200_000,
        replay_share=0.01,
    )
