"""Resolved-rate inverse kinematics of the end effector: feed-forward for an expert that reaches."""

from __future__ import annotations

import mujoco
import numpy as np
import torch

from lacoloco.pipelines.masking import pick, put
from lacoloco.pipelines.sim.kinematics import EndEffectorChain
from lacoloco.pipelines.sim.physics import CONTROL_DT
from lacoloco.robots.spec import RobotSpec

GAIN = 3.0
"""Share of the way to the target per second."""
SPEED = 2.0
"""rad/s, the fastest that the reference of a joint moves."""
REST_GAIN = 0.15
"""Share of the way back to the default pose per second, while the target is far."""
FARTHEST = 1.0 / 3.0
"""Share of the chain's length beyond which a target pulls no harder."""
DAMPING = 0.13
"""The same, of the damped least squares: how far a stretched arm gives up."""


class ReachServo:
    """Joint positions of the chain between base and end effector, led towards a target.

    Attributes:
        joints: Columns of the chain's joints.
        joint_pos: (N, K) where they are to be now [rad].
    """

    def __init__(self, spec: RobotSpec, num_worlds: int, device: torch.device) -> None:
        """Start in the default pose."""
        self._chain = EndEffectorChain(spec, device)
        self.joints = list(self._chain.joints)
        every = torch.tensor(
            [spec.default_joint_pos, spec.retarget_lower, spec.retarget_upper], device=device
        )
        self._rest, self._lower, self._upper = every[:, self.joints]
        self._ease = _ease(spec, self.joints).to(device)
        self.joint_pos = self._rest.repeat(num_worlds, 1)

    def advance(self, qpos: torch.Tensor, target: torch.Tensor) -> None:
        """One control step towards ``target`` (N, 3) [m], from positions (N, 7 + J)."""
        end, jacobian = self._chain.jacobian(qpos)
        length = self._chain.length
        error = target - end
        distance = torch.linalg.vector_norm(error, dim=1, keepdim=True)
        error = error * (FARTHEST * length / distance.clamp_min(FARTHEST * length))
        eased = jacobian * self._ease
        square = eased @ jacobian.mT + (DAMPING * length) ** 2 * torch.eye(3, device=end.device)
        rate = GAIN * (eased.mT @ torch.linalg.solve(square, error[:, :, None]))[:, :, 0]
        home = REST_GAIN * (self._rest - self.joint_pos) * (distance > DAMPING * length)
        moved = self.joint_pos + CONTROL_DT * (rate.clamp(-SPEED, SPEED) + home)
        self.joint_pos = torch.minimum(torch.maximum(moved, self._lower), self._upper)

    def reset_joints(self, worlds: torch.Tensor, qpos: torch.Tensor) -> None:
        """Go on in ``worlds`` from where the joints of ``qpos`` (N, 7 + J) are."""
        self.joint_pos = self.joint_pos.clone()
        columns = [7 + joint for joint in self.joints]
        put(self.joint_pos, worlds, pick(qpos[:, columns], worlds))


def _ease(spec: RobotSpec, joints: list[int]) -> torch.Tensor:
    """(K,) how willingly each joint moves, the lightest 1: the inverse of what it has to turn, from
    the mass matrix in the default pose. So the arm moves before the trunk does.
    """
    model = spec.model()
    data = mujoco.MjData(model)
    data.qpos[:] = spec.default_qpos()
    mujoco.mj_forward(model, data)
    full = np.zeros((model.nv, model.nv))
    mujoco.mj_fullM(model, data, full)
    inertia = full.diagonal()[6:][joints]
    return torch.tensor(inertia.min() / inertia, dtype=torch.float32)
