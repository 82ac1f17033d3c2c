"""The end effector by torch against MuJoCo's own kinematics."""

import mujoco
import numpy as np
import torch

from lacoloco.pipelines.sim.kinematics import EndEffectorChain


def test_end_effector_is_where_mujoco_puts_it(robot):
    model = robot.model()
    data = mujoco.MjData(model)
    rng = np.random.default_rng(0)
    qpos = rng.normal(size=(50, model.nq))
    qpos[:, 3:7] /= np.linalg.norm(qpos[:, 3:7], axis=1, keepdims=True)

    found = EndEffectorChain(robot)(torch.tensor(qpos, dtype=torch.float32))

    body = model.body(robot.end_effector.body).id
    for row, point in zip(qpos, found.numpy(), strict=True):
        data.qpos[:] = row
        mujoco.mj_kinematics(model, data)
        turn = data.xmat[body].reshape(3, 3)
        expected = data.xpos[body] + turn @ robot.end_effector.offset
        np.testing.assert_allclose(point, expected, atol=2e-6)


def test_foot_hangs_two_segments_below_the_hip(solo12):
    """Solo12's front right foot with straight legs: facts of the model, section 1."""
    qpos = torch.zeros(1, 19)
    qpos[0, 2], qpos[0, 3] = 1.0, 1.0
    (point,) = EndEffectorChain(solo12)(qpos)
    model = solo12.model()
    depth = -sum(float(model.body(f"FR_{part}").pos[2]) for part in ("LOWER_LEG", "FOOT"))
    assert torch.isclose(point[2], torch.tensor(1.0 - depth), atol=1e-6)
    assert point[1] < 0 < point[0]
