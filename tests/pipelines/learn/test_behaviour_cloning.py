"""Behaviour cloning: latents come to say which of two behaviours to show in the same state."""

import pytest
import torch
from tensordict import TensorDict

from lacoloco.pipelines.learn.behaviour_cloning import CloningData, clone
from lacoloco.pipelines.learn.networks import NetworkConfig, make_actor
from lacoloco.pipelines.learn.skill_embedding import (
    FlattenedClips,
    SkillEmbedding,
    WindowConfig,
    uniformity,
)

CLIP = 40


@pytest.fixture
def cloned():
    """Clips of two kinds; the kind shows in the first feature of every frame but the policy's own
    view hides it.
    """
    torch.manual_seed(0)
    generator = torch.Generator().manual_seed(0)
    kinds = torch.arange(40) % 2
    kind = torch.repeat_interleave(kinds, CLIP)
    frames = torch.randn(len(kind), 6, generator=generator)
    seen = frames.clone()
    frames[:, 0] = 2.0 * kind - 1.0 + 0.3 * frames[:, 0]
    last = torch.repeat_interleave((torch.arange(40) + 1) * CLIP - 1, CLIP)
    actions = torch.where(kind[:, None] == 1, 0.3, -0.3) * torch.ones(1, 2)
    embedding = SkillEmbedding(
        FlattenedClips(frames, last), 3, WindowConfig(steps=10, ahead=5, frames=4, hidden=(32,))
    )
    actor = make_actor({"policy": 8, "latent": 3}, 2, NetworkConfig(actor=(32,)))
    data = CloningData(seen, torch.zeros_like(actions), actions, torch.zeros(8), 0.1)

    def starts(count):
        return torch.randint(0, len(kind) - 1, (count,), generator=generator)

    def sample(count):
        windows = starts(count)
        return windows, embedding.moments(windows, generator)

    error = clone(actor, embedding, data, sample, steps=400, batch=256, generator=generator)
    return actor, embedding, data, kind, error


def test_the_latent_tells_which_behaviour_to_show(cloned):
    actor, embedding, data, kind, error = cloned
    assert error < 0.1
    views = torch.cat((data.frames, data.previous), dim=1)
    starts = torch.arange(0, len(kind), 7)
    # Each state with the latent of a window of the other kind: the latent decides, not the state.
    other = (starts + CLIP) % len(kind)
    obs = TensorDict(
        {"policy": views[starts], "latent": embedding(other)}, batch_size=[len(starts)]
    )
    assert (actor(obs) - data.actions[other]).abs().mean() < 0.1


def test_the_latents_of_the_clips_are_uniform(cloned):
    _, embedding, _, kind, _ = cloned
    z = embedding(
        torch.randint(0, len(kind) - 1, (1000,), generator=torch.Generator().manual_seed(3))
    )
    even = torch.nn.functional.normalize(
        torch.randn(1000, 3, generator=torch.Generator().manual_seed(4)), dim=-1
    )
    assert float(uniformity(z.detach())) < 0.9 * float(uniformity(even))


def test_a_history_is_that_of_the_same_clip_with_its_own_columns():
    """Two clips of three rows; frames count rows, actions before are negative."""
    frames, previous = torch.arange(6.0)[:, None], -torch.arange(6.0)[:, None]
    before = torch.tensor([0, 0, 1, 3, 3, 4])
    data = CloningData(
        frames,
        previous,
        torch.zeros(6, 1),
        torch.zeros(2),
        action_noise=0.0,
        before=before,
        history=3,
        columns=torch.tensor([0, 2, 4, 5]),
    )
    seen = data.observe(torch.tensor([2, 4, 3]), torch.Generator().manual_seed(0))
    assert seen.tolist() == [[2, 1, 0, 0], [4, 3, 3, -3], [3, 3, 3, -3]]
    more = data.extended(10.0 + frames[:2], previous[:2], torch.zeros(2, 1), torch.tensor([0, 0]))
    seen = more.observe(torch.tensor([7]), torch.Generator().manual_seed(0))
    assert seen.tolist() == [[11, 10, 10, 0]]
