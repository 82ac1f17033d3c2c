"""World position of a point of the robot, from generalised coordinates, in torch.

Both engines leave body positions one substep behind the state; this chain of hinges costs less than
another pass.
"""

from __future__ import annotations

import torch

from lacoloco.datasets.rotations import multiply, rotate
from lacoloco.robots.spec import RobotSpec


class PointChain:
    """Forward kinematics of the joints between the base and a point (hinges through their body's
    origin).

    Attributes:
        joints: Columns of these joints among all J, from the base on.
        length: Metres from the first joint to the point with the chain stretched out.
    """

    def __init__(
        self,
        spec: RobotSpec,
        body: str,
        offset: tuple[float, float, float] = (0.0, 0.0, 0.0),
        device: torch.device | str = "cpu",
    ) -> None:
        """Read the chain's fixed offsets, rotations and axes from the robot's model."""
        model = spec.model()
        self._links: list[tuple[torch.Tensor, torch.Tensor | None, torch.Tensor | None, int]] = []
        current = model.body(body).id
        while model.body_parentid[current] != 0:
            joint = int(model.body_jntadr[current])
            axis = (
                None
                if joint < 0
                else torch.tensor(model.jnt_axis[joint], dtype=torch.float32, device=device)
            )
            column = -1 if joint < 0 else int(model.jnt_qposadr[joint])
            position = torch.tensor(model.body_pos[current], dtype=torch.float32, device=device)
            rotation = torch.tensor(model.body_quat[current], dtype=torch.float32, device=device)
            turned = bool((model.body_quat[current] != (1.0, 0.0, 0.0, 0.0)).any())
            self._links.insert(0, (position, rotation if turned else None, axis, column))
            current = int(model.body_parentid[current])
        self._offset = (
            torch.tensor(offset, dtype=torch.float32, device=device) if any(offset) else None
        )
        self.joints = tuple(column - 7 for _, _, axis, column in self._links if axis is not None)
        last = 0.0 if self._offset is None else float(torch.linalg.vector_norm(self._offset))
        self.length = last + sum(
            float(torch.linalg.vector_norm(position)) for position, _, _, _ in self._links[1:]
        )

    def __call__(self, qpos: torch.Tensor) -> torch.Tensor:
        """(N, 7 + J) generalised positions -> (N, 3) the point, world [m]."""
        position, rotation = qpos[:, :3], qpos[:, 3:7]
        for link in self._links:
            position, rotation = _along(link, qpos, position, rotation)
        if self._offset is None:
            return position
        return position + rotate(rotation, self._offset.expand_as(position))

    def jacobian(self, qpos: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        """The point (N, 3) [m] and its derivatives by the K joints of the chain (N, 3, K)
        [m/rad].
        """
        position, rotation = qpos[:, :3], qpos[:, 3:7]
        anchors, axes = [], []
        for link in self._links:
            position, rotation = _along(link, qpos, position, rotation)
            if link[2] is not None:
                anchors.append(position)
                axes.append(rotate(rotation, link[2].expand_as(position)))
        if self._offset is not None:
            position = position + rotate(rotation, self._offset.expand_as(position))
        columns = [
            torch.linalg.cross(axis, position - anchor)
            for axis, anchor in zip(axes, anchors, strict=True)
        ]
        return position, torch.stack(columns, dim=-1)


class EndEffectorChain(PointChain):
    """The chain to the point that reaches for targets."""

    def __init__(self, spec: RobotSpec, device: torch.device | str = "cpu") -> None:
        """Read it from the robot."""
        super().__init__(spec, spec.end_effector.body, spec.end_effector.offset, device)


def _along(
    link: tuple[torch.Tensor, torch.Tensor | None, torch.Tensor | None, int],
    qpos: torch.Tensor,
    position: torch.Tensor,
    rotation: torch.Tensor,
) -> tuple[torch.Tensor, torch.Tensor]:
    """Position (N, 3) and rotation (N, 4) of the next body, world."""
    offset, turn, axis, column = link
    position = position + rotate(rotation, offset.expand_as(position))
    if turn is not None:
        rotation = multiply(rotation, turn.expand_as(rotation))
    if axis is None:
        return position, rotation
    half = 0.5 * qpos[:, column : column + 1]
    turn = torch.cat((torch.cos(half), torch.sin(half) * axis), dim=-1)
    return position, multiply(rotation, turn)
