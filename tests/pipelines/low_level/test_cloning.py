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


def asked(noise):
    """A cloning that has asked once, and who was asked."""
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
    return cloning, labels


def latents(noise):
    cloning, labels = asked(noise)
    return labels.latents, cloning._embedding(torch.tensor([0, 0, 0, 5, 30]))


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


def test_answers_are_of_clips_and_of_who_was_asked_until_they_are_forgotten():
    cloning, _ = asked(0.0)
    cloning._asked.actions[:] = 7.0
    observations, actions = cloning.answers(8)
    assert observations["policy"].shape == (8, 4) and observations["latent"].shape == (8, DIM)
    assert (actions == 7.0).all(dim=1).sum() == 4
    cloning.forget(3)
    assert (cloning.answers(8)[1] == 7.0).any() and len(cloning._asked) == 3
    cloning.forget(0)
    assert not (cloning.answers(8)[1] == 7.0).any()


def test_states_that_are_kept_keep_those_before_them():
    rows = torch.arange(6)
    values = rows[:, None].float()
    before = torch.tensor([0, 0, 1, 2, 4, 4])
    states = LabelledStates(values, values, values, rows, before)
    for seed in range(20):
        some = states.sampled(2, 2, torch.Generator().manual_seed(seed))
        assert 1 <= len(some) <= 2
        newest = some.rows[-1]
        assert some.rows[some.before[-1]] == before[newest]
        assert torch.equal(some.frames[:, 0].long(), some.rows)
    assert states.sampled(6, 2, torch.Generator()) is states
