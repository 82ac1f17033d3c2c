"""What latents are predicted to do, and a policy that is made from it."""

from dataclasses import replace

import pytest
import torch
from tensordict import TensorDict

from lacoloco.datasets.rotations import from_yaw
from lacoloco.pipelines.high_level.config import SkillDynamicsConfig
from lacoloco.pipelines.high_level.skill_dynamics import (
    SkillDynamics,
    fit_dynamics,
    fit_policy,
    targets,
)
from lacoloco.pipelines.high_level.trials import OFFSETS, Trials
from lacoloco.pipelines.learn.latents import project, sample_latents
from lacoloco.pipelines.learn.networks import NetworkConfig, make_actor
from lacoloco.pipelines.sim.commands import TargetCommand

COMMAND = TargetCommand(radius=1.5, z=(0.2, 0.4))
CONFIG = SkillDynamicsConfig(model_steps=400, policy_steps=400, batch=256)
COLUMNS = {"target": slice(2, 5), "last_latent": slice(5, 9)}
HEIGHT, SPEED = 0.25, 0.05


def generator(seed=0):
    return torch.Generator().manual_seed(seed)


def make_trials(count=4000, falls=False):
    """A latent of four moves the hand by its first three numbers, ``SPEED`` m a decision. With
    ``falls`` the robot falls where the fourth is positive.
    """
    latent = sample_latents(count, 4, generator())
    obs = torch.randn(count, 9, generator=generator(1))
    ahead = torch.tensor(OFFSETS)[:, None] * SPEED * latent[:, None, :3]
    fell = (latent[:, 3:] > 0.0).expand(count, len(OFFSETS)) & falls
    yaw = torch.arange(count).float()
    place = torch.stack((yaw, -yaw, torch.full((count,), HEIGHT)), dim=-1)
    reached = torch.tensor([0.2, 0.0, 0.0]) + ahead
    return Trials(obs, latent, place, from_yaw(yaw), reached, ~fell, fell)


def fitted(trials):
    model = SkillDynamics(9, 4, COLUMNS)
    return model, fit_dynamics(model, trials, CONFIG, generator())


def test_only_the_robot_is_looked_at():
    assert SkillDynamics(9, 4, COLUMNS).looked_at.tolist() == [0, 1]


def test_it_learns_where_latents_lead():
    trials = make_trials()
    model, error = fitted(trials)
    assert error < 0.1 * float(trials.reached.flatten(0, 1).std(dim=0).norm())
    places, logits = model(trials.obs, trials.latent)
    assert places.shape == trials.reached.shape
    assert (logits.sigmoid() < 0.1).all(), "nobody fell"


def test_it_learns_which_latents_fall():
    trials = make_trials(falls=True)
    model, _ = fitted(trials)
    told = model(trials.obs, trials.latent)[1] > 0.0
    assert (told == trials.fell).float().mean() > 0.95


@pytest.mark.parametrize("falls", [False, True])
def test_the_policy_goes_to_its_target_and_does_not_fall(falls):
    trials = make_trials(falls=falls)
    model, _ = fitted(trials)
    torch.manual_seed(0)
    actor = make_actor({"policy": 9}, 4, NetworkConfig(actor=(64,), critic=(64,)))
    before = [value.clone() for value in model.state_dict().values()]
    distance = fit_policy(actor, model, trials, COMMAND, COLUMNS, CONFIG, generator())
    assert 0.0 < distance < 2.0
    assert all(map(torch.equal, before, model.state_dict().values())), "only the policy learns"
    obs = trials.obs[:500].clone()
    obs[:, COLUMNS["target"]] = torch.tensor([0.2, 0.8, 0.0])
    obs[:, COLUMNS["last_latent"]] = trials.latent[:500]
    latent = project(actor(TensorDict({"policy": obs}, batch_size=[500])))
    assert (latent[:, 1] > 0.7).float().mean() > 0.9
    if falls:
        assert (latent[:, 3] < 0.1).float().mean() > 0.9


def test_every_other_target_is_near_and_as_high_as_the_tasks():
    trials, rows = make_trials(), torch.arange(1000).flip(0)
    drawn = targets(trials, rows, COMMAND, COLUMNS, generator())
    assert torch.equal(drawn[::2], trials.obs[rows[::2], COLUMNS["target"]])
    near = drawn[1::2]
    height = near[:, 2] + HEIGHT
    assert float(height.min()) >= 0.2
    assert float(height.max()) <= 0.4
    farthest = 0.2 + OFFSETS[-1] * SPEED
    assert float(near[:, :2].norm(dim=1).max()) <= farthest + 1e-4
    assert float(near[:, 1].std()) > 0.1


def test_where_all_fell_at_once_targets_are_their_own():
    trials = make_trials()
    fell = torch.ones_like(trials.fell)
    fallen = replace(trials, standing=~fell, fell=fell)
    drawn = targets(fallen, torch.arange(10), COMMAND, COLUMNS, generator())
    assert torch.equal(drawn, trials.obs[:10, COLUMNS["target"]])
