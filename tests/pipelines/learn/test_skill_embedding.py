"""Windows of clips as latents: what they look at, and that uniformity means what it says."""

import math

import pytest
import torch

from lacoloco.pipelines.learn.latents import sample_latents
from lacoloco.pipelines.learn.skill_embedding import (
    FlattenedClips,
    LabelledTransitions,
    SkillEmbedding,
    WindowConfig,
    uniformity,
)

WINDOW = WindowConfig(steps=8, ahead=4, frames=5, hidden=(16,))


@pytest.fixture
def flattened():
    """Two clips of 20 and 10 frames; a frame's first number is its row."""
    torch.manual_seed(0)
    frames = torch.randn(30, 3)
    frames[:, 0] = torch.arange(30)
    return FlattenedClips(frames, torch.tensor([19] * 20 + [29] * 10))


def test_a_window_never_looks_into_another_clip(flattened):
    embedding = SkillEmbedding(flattened, 3, WINDOW)
    starts = torch.tensor([2, 14, 17])
    before = embedding(starts)
    embedding._normalized[20:] += 100.0
    assert torch.equal(embedding(starts), before)
    embedding._normalized[19] += 100.0
    changed = (embedding(starts) != before).any(dim=1)
    assert changed.tolist() == [False, True, True]


def test_latents_are_unit_vectors(flattened):
    z = SkillEmbedding(flattened, 3, WINDOW)(torch.arange(29))
    assert torch.allclose(z.norm(dim=-1), torch.ones(29), atol=1e-6)


def test_a_window_stands_for_its_first_moments_only(flattened):
    embedding = SkillEmbedding(flattened, 3, WINDOW)
    generator = torch.Generator().manual_seed(0)
    starts = torch.full((500,), 5)
    moments = embedding.moments(starts, generator)
    assert sorted(set(moments.tolist())) == [5, 6, 7, 8, 9]
    assert set(embedding.moments(torch.full((50,), 17), generator).tolist()) == {17, 18}


def test_labelled_transitions_are_one_step_apart_and_carry_their_windows_latent(flattened):
    embedding = SkillEmbedding(flattened, 3, WINDOW)
    starts = torch.tensor([0, 7, 18, 22])
    labelled = LabelledTransitions(flattened, embedding, lambda count: starts[:count])
    transitions, z = labelled(4, torch.Generator().manual_seed(1))
    before, after = transitions[:, :3], transitions[:, 3:]
    assert torch.equal(after[:, 0], before[:, 0] + 1)
    assert ((before[:, 0] >= starts) & (before[:, 0] <= starts + 4)).all()
    assert torch.equal(z, embedding(starts)) and not z.requires_grad


def test_uniformity_of_two_opposite_points_is_known():
    # Squared distance 4: log exp(-8).
    assert math.isclose(
        float(uniformity(torch.tensor([[1.0, 0.0], [-1.0, 0.0]]))), -8.0, abs_tol=1e-5
    )


def test_uniformity_is_least_for_the_uniform_distribution():
    generator = torch.Generator().manual_seed(0)
    even = sample_latents(500, 7, generator)
    half = torch.cat((even[:, :1].abs(), even[:, 1:]), dim=1)
    assert uniformity(even) < uniformity(half) - 0.1 < uniformity(even[:1].expand(500, 7)) - 0.2
