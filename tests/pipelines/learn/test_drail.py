"""The diffusion discriminator."""

import pytest
import torch

from lacoloco.pipelines.learn.drail import DrailConfig, DrailDiscriminator, cosine_schedule

SMALL = DrailConfig(hidden=16, layers=2)


def generator(seed=0):
    return torch.Generator().manual_seed(seed)


def make(config=SMALL, dim=6, seed=0):
    torch.manual_seed(seed)
    return DrailDiscriminator(dim, config)


def blind(network):
    """Let the denoiser see no label."""
    with torch.no_grad():
        network.label.weight[1] = network.label.weight[0]
    return network


def test_a_label_blind_network_says_exactly_nothing():
    """Bug B11: independent draws per label leave a noise of +-0.5 in the original's logits."""
    logits = blind(make()).logits(torch.randn(200, 6, generator=generator()), generator(1))
    assert torch.equal(logits, torch.zeros(200))


def test_a_network_that_sees_the_label_says_something():
    logits = make().logits(torch.randn(200, 6, generator=generator()), generator(1))
    assert float(logits.detach().abs().min()) > 0.0


def test_exchanging_the_labels_changes_the_sign_and_nothing_else():
    network, sample = make(), torch.randn(50, 6, generator=generator())
    before = network.logits(sample, generator(1))
    with torch.no_grad():
        network.label.weight.copy_(network.label.weight.flip(0))
    assert torch.equal(network.logits(sample, generator(1)), -before)


def test_logit_is_the_scaled_difference_of_two_mean_errors():
    """Against the definition, one label and one diffusion time at a time."""
    network, count = make(), 5
    sample = torch.randn(count, 6, generator=generator())
    random = generator(1)
    times = network._times(count, random)
    noise = torch.randn(count, SMALL.samples, 6, generator=random)
    errors = torch.zeros(2, count)
    for label in (0, 1):
        for row in range(count):
            for k in range(SMALL.samples):
                t, eps = times[row, k], noise[row, k]
                noisy = network.alpha_bar[t].sqrt() * sample[row]
                noisy = noisy + (1 - network.alpha_bar[t]).sqrt() * eps
                hidden = network.entry(noisy) + network.time.weight[t] + network.label.weight[label]
                for layer in network.hidden:
                    hidden = layer(torch.nn.functional.relu(hidden))
                predicted = network.exit(torch.nn.functional.relu(hidden))
                errors[label, row] += (predicted - eps).square().mean().detach() / SMALL.samples
    expected = SMALL.scale * (errors[0] - errors[1])
    found = network.logits(sample, generator(1))
    assert torch.allclose(found, expected, rtol=1e-4, atol=1e-5)


def test_each_stratum_of_times_is_drawn_once_per_transition():
    config = DrailConfig(hidden=8, layers=1, steps=1000, samples=4)
    # Over the whole schedule, or over the part of it that the configuration names.
    low, high = (1000 * share for share in getattr(config, "times", (0.0, 1.0)))
    times = make(config)._times(500, generator())
    assert times.shape == (500, 4)
    width = (high - low) / 4
    for stratum in range(4):
        column = times[:, stratum]
        start = low + width * stratum
        assert start - 1 <= int(column.min()) < start + 10
        assert start + width - 10 <= int(column.max()) <= start + width


def test_times_stay_below_the_number_of_steps():
    config = DrailConfig(hidden=8, layers=1, steps=3, samples=2)
    times = make(config)._times(1000, generator())
    assert set(times.flatten().tolist()) == {0, 1, 2}


def test_schedule_has_the_published_values():
    alpha_bar = cosine_schedule(1000)
    assert alpha_bar.shape == (1000,)
    found = alpha_bar[[249, 499, 749]].tolist()
    assert found == pytest.approx([0.847, 0.494, 0.144], abs=1e-3)
    assert float(alpha_bar[999]) < 1e-4
    assert float(alpha_bar[0]) > 0.999
    assert (alpha_bar.diff() < 0).all()


def test_equal_draws_give_equal_logits():
    network, sample = make(), torch.randn(9, 6)
    assert torch.equal(network.logits(sample, generator(3)), network.logits(sample, generator(3)))
    assert not torch.equal(
        network.logits(sample, generator(3)), network.logits(sample, generator(4))
    )


def test_loss_is_the_cross_entropy_of_its_logits():
    network = blind(make())
    loss, metrics = network.loss(torch.randn(8, 6), torch.randn(12, 6), generator())
    assert float(loss.detach()) == pytest.approx(0.5 * 2 * 0.6931472)
    assert {"agent_accuracy", "demo_accuracy", "agent_logit", "demo_logit"} <= set(metrics)


def test_every_weight_that_can_matter_learns():
    network = make()
    loss, _ = network.loss(torch.randn(64, 6), torch.randn(64, 6) + 1.0, generator())
    loss.backward()
    for name, parameter in network.named_parameters():
        assert float(parameter.grad.abs().max()) > 0.0, name


def test_it_learns_to_tell_two_clouds_apart():
    """Demonstrations around +1, agent around -1 in one direction of six."""
    network, random = make(DrailConfig(hidden=32, layers=2)), generator(5)
    offset = torch.zeros(6)
    offset[2] = 1.0
    optimizer = torch.optim.Adam(network.parameters(), lr=3e-3)
    for _ in range(150):
        demo = 0.3 * torch.randn(128, 6, generator=random) + offset
        agent = 0.3 * torch.randn(128, 6, generator=random) - offset
        loss, _ = network.loss(agent, demo, random)
        optimizer.zero_grad()
        loss.backward()
        optimizer.step()
    _, metrics = network.loss(agent, demo, random)
    assert float(metrics["agent_accuracy"]) > 0.9
    assert float(metrics["demo_accuracy"]) > 0.9
