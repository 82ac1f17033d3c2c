import pytest
import torch

from lacoloco.pipelines.learn.networks import (
    NetworkConfig,
    example,
    geometric,
    make_actor,
    make_critic,
    mean_std,
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


STYLED = NetworkConfig(actor=(8,), critic=(8,), style=(16,), learn_std=True)


def test_the_actor_sees_a_style_where_the_latent_was():
    actor = make_actor({"policy": 5, "latent": 3, "more": 2}, 2, STYLED)
    seen = torch.randn(4, 10)
    style = actor.mlp[0](seen)
    assert torch.equal(style[:, :5], seen[:, :5]) and torch.equal(style[:, 8:], seen[:, 8:])
    assert (style[:, 5:8].abs() < 1.0).all() and not torch.allclose(style[:, 5:8], seen[:, 5:8])
    assert torch.equal(style[:, 5:8], actor.mlp[0].mlp(seen[:, 5:8])), "of the latent alone"
    obs = {"policy": seen[:, :5], "latent": seen[:, 5:8], "more": seen[:, 8:]}
    actor(obs).square().sum().backward()
    assert actor.mlp[0].mlp[0].weight.grad.abs().sum() > 0.0


def test_a_learned_std_follows_no_schedule():
    actor = make_actor(SIZES, 2, STYLED)
    set_std(actor, 0.01)
    assert mean_std(actor) == pytest.approx(STYLED.init_std)
    assert actor.distribution.log_std_param.requires_grad


def test_a_bounded_mean_stays_within_one():
    actor = make_actor(SIZES, 2, NetworkConfig(actor=(8,), bounded_mean=True))
    with torch.no_grad():
        actor.mlp[-2].bias.copy_(torch.tensor([100.0, -100.0]))
    assert actor(example(SIZES, 1)).tolist() == [[1.0, -1.0]]
