"""The cloned policy also meets latents that no clip has."""

import torch

from lacoloco.pipelines.learn.behaviour_cloning import CloningData
from lacoloco.pipelines.learn.latents import scatter
from lacoloco.pipelines.learn.skill_embedding import (
    FlattenedClips,
    SkillEmbedding,
    WindowConfig,
)
from lacoloco.pipelines.low_level.cloning import Cloning
from lacoloco.pipelines.low_level.expert_worlds import LabelledStates
from lacoloco.pipelines.sim.clip_actions import ClipStates

FRAMES, DIM = 60, 3


class Labels:
    """Asks the policy about the same rows twice and keeps the latents that it saw."""

    def collect(self, student, noise, action_noise, history):
        rows, seen = torch.tensor([0, 1, 4, 5, 30]), torch.zeros(5, 4)
        self.latents = [student(seen, rows) for _ in range(2)]
        return LabelledStates(seen[:, :2], seen[:, 2:], seen[:, 2:], rows, rows), 0.0


def latents(noise):
    torch.manual_seed(0)
    first, last = torch.zeros(1, dtype=torch.long), torch.full((FRAMES,), FRAMES - 1)
    frames = torch.randn(FRAMES, 2)
    unused = (torch.zeros(FRAMES, width) for width in (9, 8, 2, 3))
    qpos, qvel, targets, memory = unused
    states = ClipStates(qpos, qvel, first, last, targets, memory)
    embedding = SkillEmbedding(
        FlattenedClips(frames, last), DIM, WindowConfig(steps=10, ahead=5, frames=4, hidden=(8,))
    )
    data = CloningData(frames, torch.zeros(FRAMES, 2), torch.zeros(FRAMES, 2), torch.zeros(4))
    generator, labels = torch.Generator().manual_seed(0), Labels()
    cloning = Cloning(states, embedding, data, lambda count: last[:count], generator, noise)
    cloning.ask(lambda groups: groups["latent"], labels, torch.zeros(4), 0.0)
    return labels.latents, embedding(torch.tensor([0, 0, 0, 5, 30]))


def test_a_held_latent_keeps_its_noise():
    (once, again), exact = latents(0.5)
    assert torch.equal(once, again)
    assert torch.equal(once[0], once[1]) and torch.equal(once[0], once[2]), "held"
    assert not torch.allclose(once[0], once[3])
    assert ((once - exact).norm(dim=-1) > 1e-3).all()
    assert torch.allclose(once.norm(dim=-1), torch.ones(5))


def test_without_noise_the_latents_are_those_of_the_clips():
    (once, _), exact = latents(0.0)
    assert torch.equal(once, exact)


def test_some_latents_stay_and_others_are_scattered():
    apart = scatter(4000, 7, 0.5, torch.Generator().manual_seed(0)).square().mean(dim=1).sqrt()
    assert float(apart.min()) < 0.01 and float(apart.max()) > 0.5
    assert abs(float(apart.mean()) - 0.25) < 0.02
