"""The GAN discriminator."""

import pytest
import torch

from lacoloco.pipelines.learn.discriminator import classification
from lacoloco.pipelines.learn.gan import GanConfig, GanDiscriminator


def make(**changes):
    torch.manual_seed(0)
    return GanDiscriminator(5, GanConfig(hidden=(16, 8), **{"noise": 0.0, **changes})).double()


def generator():
    return torch.Generator().manual_seed(2)


def data():
    generator = torch.Generator().manual_seed(1)
    return torch.randn(2, 10, 5, generator=generator, dtype=torch.float64)


def test_gradient_penalty_is_the_mean_squared_slope_on_demonstrations():
    """Against central differences."""
    network, (agent, demo) = make(), data()
    _, metrics = network.loss(agent, demo, generator())
    step, slopes = 1e-5, []
    with torch.no_grad():
        for column in range(5):
            ahead, behind = demo.clone(), demo.clone()
            ahead[:, column] += step
            behind[:, column] -= step
            slopes.append(
                (network.logits(ahead, generator()) - network.logits(behind, generator()))
                / (2 * step)
            )
    expected = torch.stack(slopes, dim=1).square().sum(dim=1).mean()
    assert float(metrics["gradient_penalty"]) == pytest.approx(float(expected), rel=1e-6)


def test_loss_is_the_sum_of_its_parts():
    network, (agent, demo) = make(gradient_penalty=5.0, logit_decay=0.01), data()
    loss, metrics = network.loss(agent, demo, generator())
    bce, _ = classification(network.logits(agent, generator()), network.logits(demo, generator()))
    decay = network.mlp[-1].weight.square().sum()
    expected = bce + 5.0 * metrics["gradient_penalty"] + 0.01 * decay
    assert float(loss.detach()) == pytest.approx(float(expected.detach()), rel=1e-9)


def test_the_penalty_acts_on_the_weights():
    """Its gradient must reach them, second derivatives included."""
    agent, demo = data()
    gradients = []
    for weight in (0.0, 5.0):
        network = make(gradient_penalty=weight)
        network.loss(agent, demo, generator())[0].backward()
        gradients.append(network.mlp[0].weight.grad)
    assert not torch.allclose(*gradients, atol=1e-6)


def test_demonstrations_are_not_touched():
    network, (agent, demo) = make(), data()
    network.loss(agent, demo, generator())
    assert not demo.requires_grad
    assert network.logits(demo, generator()).shape == (10,)


def test_the_logit_is_the_mean_over_noises_that_cost_no_bias():
    """Of a linear network noise changes only the variance, and four samples a quarter of that."""
    rows = torch.zeros(4000, 5, dtype=torch.float64)
    spread = []
    for samples in (1, 4):
        network = make(noise=2.0, samples=samples)
        network.mlp = torch.nn.Linear(5, 1).double()
        with torch.no_grad():
            network.mlp.weight.copy_(torch.tensor([[3.0, 0.0, 4.0, 0.0, 0.0]]))
            network.mlp.bias.fill_(0.5)
            logits = network.logits(rows, generator())
        assert float(logits.mean()) == pytest.approx(0.5, abs=0.5)
        spread.append(float(logits.std()))
    assert spread == pytest.approx([10.0, 5.0], rel=0.05)
