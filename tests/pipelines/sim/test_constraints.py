"""Constraint functions on an environment of hand-made numbers: c > 0 is a violation."""

from types import SimpleNamespace

import pytest
import torch

from lacoloco.pipelines.sim.constraints import CONSTRAINTS


@pytest.fixture
def env():
    """Two worlds, two joints, two feet, four substeps."""
    force = torch.zeros(2, 4, 2)
    force[0, 1, 0], force[0, 3, 0], force[1, 0, 1] = 30.0, 10.0, 26.0
    return SimpleNamespace(
        physics=SimpleNamespace(
            foot_force=force,
            body_force=torch.tensor([[0.0, 3.0], [0.5, 0.0]]),
            torque=torch.tensor([[1.0, -4.0], [0.0, 2.0]]),
        ),
        state=SimpleNamespace(
            joint_vel=torch.tensor([[5.0, -20.0], [1.0, 1.0]]),
            joint_pos=torch.tensor([[0.5, 0.1], [-0.3, 0.1]]),
            gravity_b=torch.tensor([[0.6, 0.0, -0.8], [0.0, 0.0, -1.0]]),
        ),
        previous=SimpleNamespace(joint_vel=torch.tensor([[5.0, -4.0], [1.0, 3.0]])),
        action=torch.tensor([[1.0, 0.0], [0.0, 0.0]]),
        previous_action=torch.tensor([[-1.0, 0.0], [0.0, 0.5]]),
        feet=SimpleNamespace(
            last_air_time=torch.tensor([[0.1, 0.1], [0.3, 0.05]]),
            touch_down=torch.tensor([[True, False], [True, True]]),
        ),
        command=torch.tensor([[0.3, 0.0, 0.0], [0.0, 0.5, 0.0]]),
        command_speed=lambda: torch.tensor([0.3, 0.5]),
        default_joint_pos=torch.tensor([0.0, 0.1]),
        abduction_columns=torch.tensor([0]),
    )


def standing(env):
    env.command_speed = lambda: torch.tensor([0.0, 0.5])
    return env


@pytest.mark.parametrize(
    ("name", "limit", "expected"),
    [
        # The largest of *all* substeps, also of the first (bug B15 of the original).
        ("foot_force", 25.0, [[5.0, -25.0], [-25.0, 1.0]]),
        ("torque", 3.0, [[-2.0, 1.0], [-3.0, -1.0]]),
        ("joint_velocity", 16.0, [[-11.0, 4.0], [-15.0, -15.0]]),
        ("joint_acceleration", 700.0, [[-700.0, 100.0], [-700.0, -600.0]]),
        ("action_rate", 80.0, [[20.0, -80.0], [-80.0, -55.0]]),
        ("undesired_contact", 1.0, [[-1.0, 2.0], [-0.5, -1.0]]),
        ("base_tilt", 0.1, [[0.5], [-0.1]]),
        # Only at a touch-down, and only by what the flight fell short.
        ("air_time", 0.2, [[0.1, 0.0], [-0.1, 0.15]]),
        ("abduction_deviation", 0.2, [[0.3], [0.0]]),
    ],
)
def test_margins_by_hand(env, name, limit, expected):
    assert torch.allclose(CONSTRAINTS[name].function(env, limit), torch.tensor(expected), atol=1e-4)


def test_only_worlds_told_to_stand_must_stand_still(env):
    margins = CONSTRAINTS["stand_still"].function(standing(env), 4.0)
    assert margins.tolist() == [[1.0, 16.0], [0.0, 0.0]]


def test_worlds_told_to_stand_owe_no_flight(env):
    assert CONSTRAINTS["air_time"].function(standing(env), 0.2)[0].tolist() == [0.0, 0.0]
