"""An expert that begins as another task's."""

import pytest
import torch

from lacoloco.pipelines.errors import StageError
from lacoloco.pipelines.generation.config import smoke_expert
from lacoloco.pipelines.generation.expert_trainer import ExpertTrainer
from lacoloco.pipelines.generation.transfer import transferred


def test_the_reacher_begins_as_a_walker_that_is_told_to_stand(h1):
    walker, reacher = (
        ExpertTrainer(h1, task, smoke_expert(), seed=seed, device="cpu")
        for seed, task in enumerate(("walk", "reach_in_place"))
    )
    reacher.start_from(walker)
    told_to_stand = torch.randn(16, walker.env.observe().shape[1])
    told_to_stand[:, 67:70] = 0.0
    reaching = told_to_stand.clone()
    reaching[:, 67:70] = torch.randn(16, 3)
    expected, found = walker.policy()(told_to_stand), reacher.policy()(reaching)
    assert torch.allclose(found, expected, atol=1e-5)
    assert expected.abs().max() > 1e-3


def test_other_views_are_refused(h1, solo12):
    one = ExpertTrainer(h1, "walk", smoke_expert(), seed=0, device="cpu")
    other = ExpertTrainer(solo12, "walk", smoke_expert(), seed=0, device="cpu")
    states = [t.algorithm.actor.state_dict() for t in (one, other)]
    with pytest.raises(StageError, match="but for its command"):
        transferred(*states, one.env.terms, other.env.terms)
