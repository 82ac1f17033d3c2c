import pytest
import torch
from small_ase import small_ase
from tensordict import TensorDict

from lacoloco.pipelines.learn.networks import NetworkConfig
from lacoloco.pipelines.learn.ppo import Ppo, PpoConfig

NETWORKS = NetworkConfig(actor=(16,), critic=(16,), init_std=0.5)


@pytest.fixture
def make_ppo():
    """Factory of a small learner: observations of 3 numbers, 2 actions."""

    def factory(worlds=4, networks=NETWORKS, **config):
        torch.manual_seed(0)
        options = {"horizon": 3, "epochs": 1, "minibatches": 1, **config}
        return Ppo({"policy": 3}, 2, worlds, PpoConfig(**options), networks)

    return factory


@pytest.fixture
def observe():
    """Factory of random observations (n, 3)."""

    def factory(worlds=4, seed=0):
        generator = torch.Generator().manual_seed(seed)
        return TensorDict(
            {"policy": torch.randn(worlds, 3, generator=generator)}, batch_size=[worlds]
        )

    return factory


@pytest.fixture
def make_ase():
    """Factory of a small adversarial learner."""
    return small_ase
