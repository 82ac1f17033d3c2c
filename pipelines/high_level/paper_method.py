"""The paper's high-level training without what this project adds to it; see
``low_level/paper_method.py``.
"""

from __future__ import annotations

from math import exp

from lacoloco.pipelines.high_level.config import SkillDynamicsConfig, TrainHighConfig
from lacoloco.pipelines.learn.networks import NetworkConfig
from lacoloco.pipelines.low_level.paper_method import ppo

STD = exp(-2.3)


def paper_method() -> TrainHighConfig:
    """An eighth of the paper's worlds and batches; as many decisions as two cores can make."""
    return TrainHighConfig(
        worlds=512,
        decisions=4_000_000,
        std=(STD, STD),
        kl_anneal=(1.0, 0.0, 1.0),
        skill_dynamics=SkillDynamicsConfig(rounds=0),
        critic_warmup=0.0,
        shaped=False,
        fall_penalty=0.0,
        contact_force_penalty=0.0,
        near_target_fraction=0.0,
        noise_free_fraction=0.0,
        randomisation=1.0,
        restart_probability=0.0,
        replay_failed_from=1.0,
        ppo=ppo(),
        networks=NetworkConfig(
            actor=(1024, 512),
            critic=(1024, 512),
            activation="relu",
            init_std=STD,
            learn_std=True,
            bounded_mean=True,
        ),
    )
