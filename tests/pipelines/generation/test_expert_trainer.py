"""Training of the experts."""

from dataclasses import replace

import pytest
import torch

from lacoloco.pipelines.generation.config import smoke_expert
from lacoloco.pipelines.generation.expert_trainer import ExpertTrainer


@pytest.fixture(params=["walk", "reach_in_place"])
def task(request):
    return request.param


def test_both_robots_learn_both_tasks(robot, task):
    trainer = ExpertTrainer(robot, task, smoke_expert(), seed=0, device="cpu")
    before = [parameter.clone() for parameter in trainer.algorithm.actor.parameters()]
    for iteration in range(2):
        metrics = trainer.iterate(iteration / 2)
    numbers = [value for value in metrics.values() if value is not None]
    assert all(torch.isfinite(torch.tensor(value)) for value in numbers)
    after = trainer.policy().actor.parameters()
    assert any(not torch.equal(old, new) for old, new in zip(before, after, strict=True))
    assert trainer.policy().head.role == task
    assert trainer.policy()(trainer.env.observe()).shape == (16, robot.num_joints)


def test_experts_learn_in_the_world_they_are_recorded_in(solo12, task):
    """Clips are recorded without noise, pushes and randomisation."""
    env = ExpertTrainer(solo12, task, smoke_expert(), seed=0, device="cpu").env
    assert env.task.noise == 0.0
    assert env.task.randomisation.push == 0.0
    assert torch.equal(env.observe()[:, : env.frame().shape[1]], env.frame())


def test_rewards_are_scaled_and_constraints_reach_the_learner(solo12):
    trainer = ExpertTrainer(solo12, "walk", smoke_expert(), seed=0, device="cpu")
    step = trainer.env.step
    violations = {c.name: torch.full((16, 1), 1.0) for c in trainer.task.constraints}
    trainer.env.step = lambda action: replace(
        step(action), reward=torch.full((16,), 0.01), violations=violations
    )
    metrics = trainer.iterate(1.0)
    worst = max(constraint.max_p for constraint in trainer.task.constraints)
    assert torch.allclose(trainer.algorithm.delta, torch.tensor(worst))
    paid = trainer.config.reward_scale * 0.01
    assert torch.allclose(trainer.algorithm.storage.rewards, torch.tensor(paid))
    assert metrics["reward"] == pytest.approx(0.01, rel=1e-5)
    assert metrics["delta"] == pytest.approx(worst, rel=1e-5)
