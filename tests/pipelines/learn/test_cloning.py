"""Behaviour cloning: a linear teacher is learned whatever the latent says."""

import torch

from lacoloco.pipelines.learn.cloning import clone
from lacoloco.pipelines.learn.latents import sample_latents
from lacoloco.pipelines.learn.networks import NetworkConfig, make_actor


def test_the_mean_action_becomes_the_recorded_one_for_any_latent():
    torch.manual_seed(0)
    draw = torch.Generator().manual_seed(0)
    frames = torch.randn(4000, 6, generator=draw)
    actions = 0.3 * frames[:, :2]
    actor = make_actor({"policy": 8, "latent": 7}, 2, NetworkConfig(actor=(64,)))
    before = (actor({"policy": torch.cat((frames, actions), 1), "latent": sample_latents(4000, 7, draw)}) - actions).std()
    error = clone(
        actor, frames, actions, actions, torch.zeros(8), latent_dim=7, action_noise=0.1, steps=300, batch=512, draw=draw
    )
    assert error < 0.2 * before
    for seed in (1, 2):
        latent = sample_latents(4000, 7, torch.Generator().manual_seed(seed))
        mean = actor({"policy": torch.cat((frames, actions), 1), "latent": latent})
        assert (mean - actions).square().mean().sqrt() < 0.2 * before
