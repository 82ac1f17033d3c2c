"""Reward terms on an environment of hand-made numbers."""

import math
from types import SimpleNamespace

import pytest
import torch

from lacoloco.pipelines.sim.rewards import RewardTerm, parameters_of


@pytest.fixture
def env():
    """One world with two joints."""
    return SimpleNamespace(
        state=SimpleNamespace(
            lin_vel_b=torch.tensor([[0.5, -0.1, 0.2]]),
            ang_vel_b=torch.tensor([[1.0, 2.0, 0.4]]),
            joint_vel=torch.tensor([[3.0, -4.0]]),
            joint_pos=torch.tensor([[0.5, 0.1]]),
            gravity_b=torch.tensor([[0.6, 0.0, -0.8]]),
        ),
        previous=SimpleNamespace(joint_vel=torch.tensor([[3.0, -4.2]])),
        command=torch.tensor([[0.2, 0.3, -0.1]]),
        action=torch.tensor([[1.0, 0.5]]),
        previous_action=torch.tensor([[0.0, -0.5]]),
        physics=SimpleNamespace(torque=torch.tensor([[1.0, -2.0]])),
        default_joint_pos=torch.tensor([0.2, 0.1]),
        target_error=lambda: torch.tensor([0.1]),
    )


@pytest.mark.parametrize(
    ("name", "parameters", "expected"),
    [
        # velocity error (0.3, -0.4): squared 0.25; yaw rate error 0.5
        ("track_planar_velocity", {"variance": 0.25}, math.exp(-1.0)),
        ("track_yaw_rate", {"variance": 0.25}, math.exp(-1.0)),
        ("reach", {"sharpness": 10.0}, math.exp(-1.0)),
        ("joint_speed", {}, 25.0),
        ("joint_torque", {}, 5.0),
        ("action_change", {}, 2.0),
        ("joint_acceleration", {}, 100.0),
        ("tilt", {}, 0.36),
        ("vertical_motion", {}, 0.04 + 0.05 * 5.0),
        ("posture", {}, 0.09),
    ],
)
def test_values_by_hand(env, name, parameters, expected):
    term = RewardTerm(name, 1.0, tuple(parameters.items()))
    assert float(term(env)) == pytest.approx(expected, rel=1e-3)


@pytest.mark.parametrize(
    "name",
    [
        "track_planar_velocity",
        "track_yaw_rate",
        "reach",
        "approach",
    ],
)
def test_kernels_pay_one_for_no_error_and_less_for_more(env, name):
    term = RewardTerm(name, 1.0, tuple((key, 0.25) for key in parameters_of(name)))
    values = []
    for error in (0.0, 0.05, 0.1, 0.4):
        env.state.lin_vel_b = env.command + error
        env.state.ang_vel_b = env.command + error
        env.target_error = lambda error=error: torch.tensor([error])
        values.append(float(term(env)))
    assert values[0] == pytest.approx(1.0, abs=1e-6)
    assert values == sorted(values, reverse=True)
    assert len(set(values)) == 4
