"""What a tracker is shown of a clip, and how near the robot is to it."""

from __future__ import annotations

import torch

from lacoloco.datasets.motion_library import MotionLibrary
from lacoloco.pipelines.sim.clip_actions import (
    ClipStates,
    clip_states,
    infer_actions,
    previous_actions,
)
from lacoloco.pipelines.sim.state import RobotState, style_frame, style_terms
from lacoloco.robots.spec import RobotSpec

AHEAD = (1, 3, 8)
"""Control steps into the future that the tracker sees: 0.02, 0.06 and 0.16 s."""
TERMS = {
    "base_height": (0.1, 400.0),
    "projected_gravity": (0.1, 20.0),
    "base_lin_vel": (0.3, 6.0),
    "base_ang_vel": (0.1, 0.5),
    "joint_pos": (0.3, 3.0),
    "joint_vel": (0.1, 0.01),
}
"""Term of the style frame -> its weight w and how sharp it is: the reward is the sum of w
exp(-sharpness |error|^2).
"""


class References:
    """The clips by row: their states, style frames and actions. The last clip is the robot standing
    (``repertoire.py``).
    """

    def __init__(self, spec: RobotSpec, library: MotionLibrary) -> None:
        """Line up the clips and infer their actions, (M, J) raw units, which takes a while."""
        self.states: ClipStates = clip_states(library)
        self.actions = infer_actions(spec, self.states, spec.action_scale)
        self.rest = int(self.states.first[-1])
        """The row from which on the robot stands still."""
        self.before = previous_actions(self.states, self.actions)
        """(M, J) the action before each row's."""
        state = RobotState.from_generalized(self.states.qpos, self.states.qvel)
        self.frames = style_frame(state)
        self.speed = state.lin_vel_b[:, :2].norm(dim=-1)
        """(M,) planar speed [m/s]."""
        self._tolerances = spec.tracking
        self._terms = style_terms(self.actions.shape[1])

    @property
    def width(self) -> int:
        """Columns of :meth:`ahead`."""
        return len(AHEAD) * self.frames.shape[1]

    def ahead(self, rows: torch.Tensor) -> torch.Tensor:
        """(N, width) style frames ``AHEAD`` of the moments ``rows`` (N,), the clip's last one
        beyond its end.
        """
        last = self.states.last[rows]
        return torch.cat(
            [self.frames[torch.minimum(rows + steps, last)] for steps in AHEAD], dim=-1
        )

    def compare(self, state: RobotState, rows: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        """(N,) reward in [0, 1] for being as the clips are at ``rows`` (N,), and (N,) bool whether
        that is hopeless.
        """
        errors = (style_frame(state) - self.frames[rows]).split(
            [term.size for term in self._terms], dim=-1
        )
        squared = {
            term.name: error.square().sum(dim=-1)
            for term, error in zip(self._terms, errors, strict=True)
        }
        reward = sum(
            weight * torch.exp(-sharpness * squared[name])
            for name, (weight, sharpness) in TERMS.items()
        )
        joints = squared["joint_pos"] / state.joint_pos.shape[1] > self._tolerances.joint_error**2
        tall, tilted = (
            squared["base_height"] > self._tolerances.height_error**2,
            squared["projected_gravity"] > self._tolerances.tilt_error**2,
        )
        return reward, joints | tall | tilted
