"""What a tracker is shown of a clip, and how near the robot is to it."""

from __future__ import annotations

import torch

from lacoloco.pipelines.sim.state import RobotState, style_frame
from lacoloco.pipelines.warm_start import ClipStates

AHEAD = (1, 3, 8)
"""Control steps into the future that the tracker sees: 0.02, 0.06 and 0.16 s."""
LOST_JOINTS, LOST_HEIGHT, LOST_TILT = 0.5, 0.08, 0.6
"""Beyond an rms joint error of so many rad, so many metres of height, or so long a difference of the unit vectors of
gravity, the robot does something else than the clip."""
TERMS = {
    "joint_pos": (0.3, 3.0),
    "joint_vel": (0.1, 0.01),
    "lin_vel": (0.3, 6.0),
    "ang_vel": (0.1, 0.5),
    "gravity": (0.1, 20.0),
    "height": (0.1, 400.0),
}
"""Term -> its weight w and how sharp it is: the reward is the sum of w exp(-sharpness |error|^2)."""


class References:
    """The clips' style frames by row, and the actions inferred for them."""

    def __init__(self, states: ClipStates, actions: torch.Tensor) -> None:
        """Take the rows of ``states`` and as many ``actions`` (M, J)."""
        self.state = RobotState.from_generalized(states.qpos, states.qvel)
        self.actions, self.last = actions, states.last
        self.frames = style_frame(self.state)
        self.speed = self.state.lin_vel_b[:, :2].norm(dim=-1)
        """(M,) planar speed [m/s]."""

    @property
    def width(self) -> int:
        """Columns of :meth:`ahead`."""
        return len(AHEAD) * self.frames.shape[1]

    def ahead(self, rows: torch.Tensor) -> torch.Tensor:
        """(N, width) style frames ``AHEAD`` of the moments ``rows`` (N,), the clip's last one beyond its end."""
        last = self.last[rows]
        return torch.cat([self.frames[torch.minimum(rows + steps, last)] for steps in AHEAD], dim=-1)

    def compare(self, state: RobotState, rows: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        """(N,) reward in [0, 1] for being as the clips are at ``rows`` (N,), and (N,) bool whether that is hopeless."""
        wanted = self.state
        errors = {
            "joint_pos": state.joint_pos - wanted.joint_pos[rows],
            "joint_vel": state.joint_vel - wanted.joint_vel[rows],
            "lin_vel": state.lin_vel_b - wanted.lin_vel_b[rows],
            "ang_vel": state.ang_vel_b - wanted.ang_vel_b[rows],
            "gravity": state.gravity_b - wanted.gravity_b[rows],
            "height": state.root_pos[:, 2:] - wanted.root_pos[rows, 2:],
        }
        squared = {name: error.square().sum(dim=-1) for name, error in errors.items()}
        reward = sum(weight * torch.exp(-sharpness * squared[name]) for name, (weight, sharpness) in TERMS.items())
        joints = squared["joint_pos"] / state.joint_pos.shape[1] > LOST_JOINTS**2
        lost = joints | (squared["height"] > LOST_HEIGHT**2) | (squared["gravity"] > LOST_TILT**2)
        return reward, lost
