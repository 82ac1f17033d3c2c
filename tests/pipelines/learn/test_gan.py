"""The GAN discriminator."""

import pytest
import torch

from lacoloco.pipelines.learn.discriminator import classification
from lacoloco.pipelines.learn.gan import GanConfig, GanDiscriminator


def make(**changes):
    torch.manual_seed(0)
    return GanDiscriminator(5, GanConfig(hidden=(16, 8), **changes)).double()


def data():
    generator = torch.Generator().manual_seed(1)
    return torch.randn(2, 10, 5, generator=generator, dtype=torch.float64)


def test_gradient_penalty_is_the_mean_squared_slope_on_demonstrations():
    """Against central differences."""
    network, (agent, demo) = make(), data()
    _, figures = network.loss(agent, demo)
    step, slopes = 1e-5, []
    with torch.no_grad():
        for column in range(5):
            ahead, behind = demo.clone(), demo.clone()
            ahead[:, column] += step
            behind[:, column] -= step
            slopes.append((network.logits(ahead) - network.logits(behind)) / (2 * step))
    expected = torch.stack(slopes, dim=1).square().sum(dim=1).mean()
    assert float(figures["gradient_penalty"]) == pytest.approx(float(expected), rel=1e-6)


def test_loss_is_the_sum_of_its_parts():
    network, (agent, demo) = make(gradient_penalty=5.0, logit_decay=0.01), data()
    loss, figures = network.loss(agent, demo)
    bce, _ = classification(network.logits(agent), network.logits(demo))
    decay = network.mlp[-1].weight.square().sum()
    expected = bce + 5.0 * figures["gradient_penalty"] + 0.01 * decay
    assert float(loss.detach()) == pytest.approx(float(expected.detach()), rel=1e-9)


def test_the_penalty_acts_on_the_weights():
    """Its gradient must reach them, second derivatives included."""
    agent, demo = data()
    gradients = []
    for weight in (0.0, 5.0):
        network = make(gradient_penalty=weight)
        network.loss(agent, demo)[0].backward()
        gradients.append(network.mlp[0].weight.grad)
    assert not torch.allclose(*gradients, atol=1e-6)


def test_demonstrations_are_not_touched():
    network, (agent, demo) = make(), data()
    network.loss(agent, demo)
    assert not demo.requires_grad
    assert network.logits(demo).shape == (10,)
