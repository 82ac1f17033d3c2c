import pytest
import torch

from lacoloco.pipelines.learn.networks import (
    NetworkConfig,
    example,
    geometric,
    make_actor,
    make_critic,
    set_std,
)

SIZES = {"policy": 5, "latent": 3}
SMALL = NetworkConfig(actor=(8,), critic=(8,), init_std=0.3)


def test_groups_are_concatenated_in_their_order():
    actor = make_actor(SIZES, 2, SMALL)
    obs = {name: torch.randn(4, size) for name, size in SIZES.items()}
    flat = torch.cat([obs["policy"], obs["latent"]], dim=-1)
    assert torch.equal(actor(obs), actor.mlp(actor.obs_normalizer(flat)))
    assert actor(obs).shape == (4, 2)
    assert make_critic(SIZES, SMALL)(obs).shape == (4, 1)


def test_exploration_is_as_wide_as_set():
    actor = make_actor(SIZES, 2, SMALL)
    for std in (None, 0.05):
        if std is not None:
            set_std(actor, std)
        actor(example(SIZES, 1), stochastic_output=True)
        assert torch.allclose(actor.output_std, torch.tensor(std or 0.3))


def test_the_std_is_not_learned():
    actor = make_actor(SIZES, 2, NetworkConfig(actor=(8,)))
    assert not actor.distribution.log_std_param.requires_grad


@pytest.mark.parametrize(
    ("share", "expected"), [(-1.0, 0.4), (0.0, 0.4), (0.5, 0.2), (1.0, 0.1), (2.0, 0.1)]
)
def test_geometric_interpolation(share, expected):
    assert geometric((0.4, 0.1), share) == pytest.approx(expected)
