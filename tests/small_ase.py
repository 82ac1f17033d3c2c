"""A small adversarial learner, and rollouts for it."""

import torch
from tensordict import TensorDict

from lacoloco.pipelines.learn.ase import Ase, AseConfig
from lacoloco.pipelines.learn.latents import project
from lacoloco.pipelines.learn.networks import NetworkConfig
from lacoloco.pipelines.learn.ppo import PpoConfig

WORLDS, HORIZON, LATENT = 8, 4, 3


def demonstrations(count):
    return torch.randn(count, 4, generator=torch.Generator().manual_seed(count))


def small_ase(worlds=WORLDS, horizon=HORIZON, seed=0, **changes):
    """A learner of frames of 2 numbers and latents of 3; ``changes`` are of its AseConfig."""
    torch.manual_seed(0)
    options = {"updates": 3, "batch": 16, "replay_capacity": 64, **changes}
    return Ase(
        {"policy": 5, "latent": LATENT},
        2,
        worlds,
        demonstrations,
        ppo=PpoConfig(horizon=horizon, epochs=1, minibatches=1),
        networks=NetworkConfig(actor=(16,), critic=(16,)),
        ase=AseConfig(**options),
        seed=seed,
    )


def observe(worlds, seed):
    generator = torch.Generator().manual_seed(seed)
    return TensorDict(
        {
            "policy": torch.randn(worlds, 5, generator=generator),
            "latent": project(torch.randn(worlds, LATENT, generator=generator)),
        },
        batch_size=[worlds],
    )


def fill(ase, frames=None, valid=None, reward=0.0):
    """Record a rollout; ``frames(step)`` gives the older frame (N, 2), the newer one is +0.5."""
    worlds = ase.num_worlds
    nobody = torch.zeros(worlds, dtype=torch.bool)
    for step in range(ase.config.horizon):
        ase.act(observe(worlds, step))
        older = frames(step) if frames else torch.randn(worlds, 2)
        ase.record_transition(older, older + 0.5, ~nobody if valid is None else valid)
        ase.record(torch.full((worlds,), reward), nobody, nobody, observe(worlds, step + 1))
    return observe(worlds, ase.config.horizon)
