"""The skill encoder and its reward."""

import pytest
import torch

from lacoloco.pipelines.learn.encoder import SkillEncoder, cosine, encoder_loss, encoder_reward


def test_reward_and_loss_by_hand():
    z = torch.tensor([[1.0, 0.0], [1.0, 0.0], [0.0, 1.0]])
    predicted = torch.tensor([[1.0, 0.0], [-1.0, 0.0], [0.6, 0.8]])
    assert cosine(predicted, z).tolist() == pytest.approx([1.0, -1.0, 0.8])
    # A wrong guess earns nothing, but it counts fully in the loss.
    assert encoder_reward(predicted, z).tolist() == pytest.approx([1.0, 0.0, 0.8])
    assert float(encoder_loss(predicted, z)) == pytest.approx(-0.8 / 3)


def test_predictions_are_unit_vectors():
    predicted = SkillEncoder(10, 7, (16,))(5.0 * torch.randn(50, 10))
    assert predicted.shape == (50, 7)
    assert torch.allclose(predicted.norm(dim=-1), torch.ones(50), atol=1e-5)


def test_it_learns_a_direction_that_the_transition_shows():
    torch.manual_seed(0)
    encoder = SkillEncoder(4, 3, (32,))
    optimizer = torch.optim.Adam(encoder.parameters(), lr=1e-2)
    for _ in range(150):
        z = torch.nn.functional.normalize(torch.randn(128, 3), dim=-1)
        seen = torch.cat([2.0 * z.flip(-1), torch.randn(128, 1)], dim=-1)
        loss = encoder_loss(encoder(seen), z)
        optimizer.zero_grad()
        loss.backward()
        optimizer.step()
    assert float(loss.detach()) < -0.95
