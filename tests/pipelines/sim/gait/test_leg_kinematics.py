"""Ankles by inverse kinematics against MuJoCo's own."""

import mujoco
import numpy as np
import pytest
import torch

from lacoloco.pipelines.sim.gait.leg_kinematics import find_legs
from lacoloco.robots.errors import RobotError


def test_the_default_pose_is_found_from_its_ankles(h1):
    for leg in find_legs(h1):
        forward, below = (torch.tensor([value]) for value in leg.ankle())
        assert leg.solve(forward, below)[0].tolist() == pytest.approx(leg.default, abs=1e-5)


def test_an_ankle_is_where_it_was_asked_to_be_with_a_level_sole(h1):
    model = h1.model()
    data = mujoco.MjData(model)
    for leg, foot in zip(find_legs(h1), h1.feet, strict=True):
        for forward, below in ((0.0, 0.75), (0.2, 0.65), (-0.25, 0.7)):
            data.qpos[:] = h1.default_qpos()
            angles = leg.solve(torch.tensor([forward]), torch.tensor([below]))[0]
            data.qpos[[7 + column for column in leg.pitch]] = angles.numpy()
            mujoco.mj_kinematics(model, data)
            hip, ankle = (data.xanchor[1 + leg.pitch[i]] for i in (0, 2))
            np.testing.assert_allclose((ankle - hip)[[0, 2]], (forward, -below), atol=1e-5)
            level = data.body(foot).xmat.reshape(3, 3)[2]
            data.qpos[:] = h1.default_qpos()
            mujoco.mj_kinematics(model, data)
            default = data.body(foot).xmat.reshape(3, 3)[2]
            np.testing.assert_allclose(level, default, atol=1e-5)


def test_an_ankle_out_of_reach_is_brought_nearer(h1):
    (leg, _) = find_legs(h1)
    angles = leg.solve(torch.tensor([0.0]), torch.tensor([2.0]))
    assert torch.isfinite(angles).all()
    assert abs(angles[0, 1]) < 0.3  # almost straight


def test_legs_without_an_ankle_are_refused(solo12):
    with pytest.raises(RobotError, match="2 joints about y"):
        find_legs(solo12)
