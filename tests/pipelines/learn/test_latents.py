"""Latents: uniform on the sphere, held for a while."""

import pytest
import torch

from lacoloco.pipelines.learn.latents import (
    LatentConfig,
    LatentSchedule,
    latent_usage,
    project,
    sample_latents,
)

NOBODY = torch.zeros(3, dtype=torch.bool)


def schedule(worlds=3, **config):
    return LatentSchedule(worlds, LatentConfig(**config), seed=0)


def test_projection_is_to_the_unit_sphere():
    u = torch.tensor([[3.0, 4.0], [-0.1, 0.0]])
    assert torch.allclose(project(u), torch.tensor([[0.6, 0.8], [-1.0, 0.0]]))
    assert torch.isfinite(project(torch.zeros(1, 7))).all()


def test_latents_are_uniform_on_the_sphere():
    z = sample_latents(20_000, 7, torch.Generator().manual_seed(0))
    assert torch.allclose(z.norm(dim=-1), torch.ones(20_000), atol=1e-5)
    assert torch.allclose(z.mean(0), torch.zeros(7), atol=0.01)
    assert torch.allclose(z.T @ z / 20_000, torch.eye(7) / 7, atol=0.01)


def test_durations_fill_one_to_149_steps():
    """As in the paper's code."""
    remaining = schedule(worlds=20_000).remaining
    assert int(remaining.min()) == 1
    assert int(remaining.max()) == 149
    assert abs(float(remaining.float().mean()) - 75.0) < 1.0


def test_a_latent_lives_exactly_as_long_as_drawn():
    latents = schedule(worlds=40, min_steps=2, max_steps=6)
    nobody = torch.zeros(40, dtype=torch.bool)
    due, start = latents.remaining.clone(), latents.z
    for step in range(1, 7):
        latents.advance(nobody)
        same = (latents.z == start).all(dim=-1)
        assert torch.equal(same, due > step)


def test_a_reset_brings_a_new_latent():
    latents = schedule(min_steps=50)
    before = latents.z
    latents.advance(torch.tensor([False, True, False]))
    assert (latents.z == before).all(dim=-1).tolist() == [True, False, True]
    assert torch.allclose(latents.z.norm(dim=-1), torch.ones(3), atol=1e-6)


def test_latent_random_walks_move_on_in_small_steps_until_a_reset():
    walking = torch.arange(400) < 200
    config = LatentConfig(
        min_steps=50,
        random_walk_step_size=(0.1, 0.1),
        random_walk_steps=2,
        resample_probability=0.0,
    )
    latents = LatentSchedule(400, config, seed=0)
    latents.random_walk, latents.remaining = walking, torch.where(walking, 2, latents.remaining)
    nobody = torch.zeros(400, dtype=torch.bool)
    before = latents.z
    latents.advance(nobody)
    assert torch.equal(latents.z, before)
    latents.advance(nobody)
    cosine = (latents.z * before).sum(dim=-1)
    assert torch.equal(cosine[200:].round(decimals=4), torch.ones(200)), "the others hold theirs"
    assert (cosine[:200] < 0.9999).all()
    assert 0.9 < float(cosine[:200].mean()) < 0.99
    latents.advance(walking)
    assert abs(float((latents.z * before).sum(dim=-1)[:200].mean())) < 0.1, (
        "a new episode, a new latent"
    )


def test_every_random_walk_has_a_step_size_of_its_own_and_resamples_now_and_then():
    latents = LatentSchedule(
        4000,
        LatentConfig(
            random_walk_step_size=(0.03, 1.0), random_walk_steps=1, resample_probability=0.1
        ),
        seed=0,
    )
    latents.random_walk[:], latents.remaining[:] = True, 1
    before = latents.z
    latents.advance(torch.zeros(4000, dtype=torch.bool))
    cosine = (latents.z * before).sum(dim=-1)
    slow, fast = latents.step_size < 0.05, latents.step_size > 0.7
    assert 0.1 < float(slow.float().mean()) < 0.2, "a seventh of the strides, geometrically spread"
    assert float(cosine[slow].median()) > 0.99 > 0.6 > float(cosine[fast].median())
    assert 0.05 < float((cosine[slow] < 0.9).float().mean()) < 0.15, "the jumps"


def test_old_latents_stay_as_they_were():
    """The transition being recorded may still refer to them."""
    latents = schedule(min_steps=1, max_steps=1)
    before = latents.z
    kept = before.clone()
    latents.advance(NOBODY)
    assert torch.equal(before, kept)
    assert not torch.equal(latents.z, kept)


def test_state_dict_goes_on_with_the_same_latents():
    first, second = schedule(max_steps=4), LatentSchedule(3, LatentConfig(max_steps=4), seed=9)
    first.advance(NOBODY)
    state = {key: value.clone() for key, value in first.state_dict().items()}
    second.load_state_dict(state)
    for _ in range(10):
        first.advance(NOBODY)
        second.advance(NOBODY)
        assert torch.equal(first.z, second.z)


def test_usage_of_the_sphere_by_hand():
    """One point; a pole and its opposite, which is one line; all seven axes both ways."""
    axes = torch.eye(7)
    found = [latent_usage(z) for z in (axes[[0] * 5], torch.stack((axes[0], -axes[0])))]
    assert [one["latent_resultant"] for one in found] == pytest.approx([1.0, 0.0])
    assert [one["latent_directions"] for one in found] == pytest.approx([1.0, 1.0], abs=1e-6)
    both = latent_usage(torch.cat((axes, -axes)))
    assert both == pytest.approx({"latent_resultant": 0.0, "latent_directions": 7.0})
    two = latent_usage(axes[:2])
    assert two == pytest.approx({"latent_resultant": 0.5**0.5, "latent_directions": 2.0})
