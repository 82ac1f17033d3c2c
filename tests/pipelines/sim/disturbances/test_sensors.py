"""Sensors: late, filtered, lost, off, noisy; and the same episodes for all of them."""

import math
from dataclasses import replace
from pathlib import Path

import pytest
import torch

from lacoloco.pipelines.sim.disturbances.config import Disturbances
from lacoloco.pipelines.sim.env import LeggedEnv
from lacoloco.pipelines.sim.state import style_frame
from lacoloco.pipelines.sim.tasks import load_task, task_from_text
from lacoloco.robots.errors import RobotError

CLEAN = {"noise": 0.0, "training_limits": False}


def built(spec, worlds=4, **fields):
    task = replace(load_task(spec, "reach"), disturbances=Disturbances(**fields), **CLEAN)
    return LeggedEnv(spec, task, worlds, seed=5)


def walked(env, steps=30):
    """Frames as they are and as they are seen, (T, N, 34) each."""
    real, seen = [], []
    generator = torch.Generator().manual_seed(2)
    for _ in range(steps):
        env.step(0.3 * torch.randn(env.num_worlds, 12, generator=generator))
        real.append(env.frame())
        seen.append(env.observe()[:, :34])
    return torch.stack(real), torch.stack(seen)


def test_a_latency_of_a_control_step_shows_the_frame_before(solo12):
    real, seen = walked(built(solo12, observation_latency=0.02))
    assert torch.allclose(seen[1:], real[:-1], atol=1e-5)


def test_motion_capture_delays_height_and_velocity_only(solo12):
    real, seen = walked(built(solo12, mocap_delay=(0.02, 0.02)))
    assert torch.allclose(seen[1:, :, 0], real[:-1, :, 0], atol=1e-5)
    other = [*range(1, 4), *range(7, 34)]
    assert torch.allclose(seen[..., other], real[..., other], atol=1e-5)
    assert not torch.allclose(seen[..., 4:7], real[..., 4:7], atol=1e-3)


def test_a_filter_lags_and_a_dropout_holds(solo12):
    real, seen = walked(built(solo12, mocap_filter=0.02))
    share = 1 - math.exp(-1.0)
    expected = seen[0, :, 0]
    for now, said in zip(real[1:, :, 0], seen[1:, :, 0], strict=True):
        expected = expected + share * (now - expected)
        assert torch.allclose(said, expected, atol=1e-5)
    real, seen = walked(built(solo12, 64, mocap_dropout=0.05, mocap_dropout_interval=0.2), 200)
    still = seen[1:, :, 0] == seen[:-1, :, 0]
    assert float(still.float().mean()) == pytest.approx(0.19, abs=0.04)  # 50 of 20 / 0.1 + 50 ms
    assert torch.allclose(seen[1:, :, 0][~still], real[1:, :, 0][~still], atol=1e-6)


def test_a_task_s_table_takes_the_same_names(solo12):
    reward = "rewards = [{ name = 'action_change', weight = -1.0 }]"
    text = reward + "\n[disturbances]\naction_latency = 0.01\nsolver = 'pgs'\n"
    task = task_from_text(solo12, text, Path("mine.toml"))
    assert task.disturbances == Disturbances(action_latency=0.01, solver="pgs")
    with pytest.raises(RobotError, match="mine.toml: disturbances.solver.*newton or pgs"):
        task_from_text(solo12, text.replace("pgs", "cg"), Path("mine.toml"))


def test_encoders_and_the_slope(solo12):
    env = built(solo12, joint_offset=0.03, floor_tilt=0.05)
    real, seen = walked(env)
    assert torch.allclose(
        seen[..., 10:22] - real[..., 10:22], env.physics.joint_offset.expand(30, 4, 12), atol=1e-6
    )
    angle = (seen[..., 1:4] * real[..., 1:4]).sum(dim=-1).clamp(max=1.0).acos()
    assert torch.allclose(angle, torch.full_like(angle, 0.05), atol=1e-3)


def test_noise_is_that_of_training_and_the_episodes_stay_the_same(solo12):
    usual, noisy, late = (
        built(solo12, **fields) for fields in ({}, {"noise": 1.0}, {"mocap_delay": (0.01, 0.03)})
    )
    for other in (noisy, late):
        assert torch.equal(usual.command, other.command)
        assert torch.equal(usual.frame(), other.frame())
        assert torch.equal(usual.parameters.friction, other.parameters.friction)
    real, seen = walked(noisy, 400)
    away = (seen - real).abs().flatten(0, 1).amax(dim=0)
    scale = noisy.noise_scale[:34]
    assert (away <= scale + 1e-6).all() and (away > 0.95 * scale).all()
    walked(usual, 400)
    assert torch.equal(usual.frame(), noisy.frame()), "pushes included"


def test_a_reset_forgets_and_a_stored_state_goes_on(solo12):
    fields = {"observation_latency": 0.02, "mocap_delay": (0.01, 0.03), "noise": 1.0}
    env = built(solo12, **fields, mocap_dropout=0.05)
    walked(env)
    state = env.state_dict()
    other = built(solo12, **fields, mocap_dropout=0.05)
    other.load_state_dict(state)
    assert all(map(torch.equal, walked(env, 5), walked(other, 5)))
    quiet = built(solo12, observation_latency=0.02)
    walked(quiet)
    quiet.reset(torch.tensor([True, False, False, False]))
    assert torch.allclose(quiet.observe()[0, :34], style_frame(quiet.state)[0], atol=1e-6)
