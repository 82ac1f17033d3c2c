"""World position of the end effector, from generalised coordinates, in torch.

Both engines leave body positions one substep behind the state; this chain of hinges costs less than
another pass.
"""

from __future__ import annotations

import torch

from lacoloco.datasets.rotations import multiply, rotate
from lacoloco.robots.spec import RobotSpec


class EndEffectorChain:
    """Forward kinematics of the joints between the base and the end effector (hinges through their
    body's origin).
    """

    def __init__(self, spec: RobotSpec, device: torch.device | str = "cpu") -> None:
        """Read the chain's fixed offsets, rotations and axes from the robot's model."""
        model = spec.model()
        self.links: list[tuple[torch.Tensor, torch.Tensor | None, torch.Tensor | None, int]] = []
        body = model.body(spec.end_effector.body).id
        while model.body_parentid[body] != 0:
            joint = int(model.body_jntadr[body])
            axis = (
                None
                if joint < 0
                else torch.tensor(model.jnt_axis[joint], dtype=torch.float32, device=device)
            )
            column = -1 if joint < 0 else int(model.jnt_qposadr[joint])
            position = torch.tensor(model.body_pos[body], dtype=torch.float32, device=device)
            rotation = torch.tensor(model.body_quat[body], dtype=torch.float32, device=device)
            turned = bool((model.body_quat[body] != (1.0, 0.0, 0.0, 0.0)).any())
            self.links.insert(0, (position, rotation if turned else None, axis, column))
            body = int(model.body_parentid[body])
        offset = spec.end_effector.offset
        self.offset = (
            torch.tensor(offset, dtype=torch.float32, device=device) if any(offset) else None
        )

    def __call__(self, qpos: torch.Tensor) -> torch.Tensor:
        """(N, 7 + J) generalised positions -> (N, 3) end effector, world [m]."""
        position, rotation = qpos[:, :3], qpos[:, 3:7]
        for offset, turn, axis, column in self.links:
            position = position + rotate(rotation, offset.expand_as(position))
            if turn is not None:
                rotation = multiply(rotation, turn.expand_as(rotation))
            if axis is not None:
                half = 0.5 * qpos[:, column : column + 1]
                rotation = multiply(
                    rotation, torch.cat((torch.cos(half), torch.sin(half) * axis), dim=-1)
                )
        if self.offset is None:
            return position
        return position + rotate(rotation, self.offset.expand_as(position))
