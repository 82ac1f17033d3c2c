"""The reference motion of a tracker: what it sees of a clip, and how its error is rewarded."""

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

LOOKAHEAD = (1, 3, 8)
"""Control steps into the future that the tracker sees: 0.02, 0.06 and 0.16 s."""
TERMS = {
    "base_height": (0.1, 400.0),
    "projected_gravity": (0.1, 20.0),
    "base_lin_vel": (0.3, 6.0),
    "base_ang_vel": (0.1, 0.5),
    "joint_pos": (0.3, 3.0),
    "joint_vel": (0.1, 0.01),
}
"""Term of the style frame -> weight w and sharpness s; the reward is the sum of all terms'
w exp(-s |error|^2).
"""


class ReferenceMotion:
    """States, style frames and actions of all clips, one row per control step, M rows in all.

    The last clip is the robot standing still, see
    :func:`lacoloco.pipelines.tracking.reference_clips.reference_clips`.

    Attributes:
        states: Generalised positions and velocities of all rows.
        actions: (M, J) inferred raw actions that lead to the next row.
        previous_actions: (M, J) raw actions of the row before.
        frames: (M, 10 + 2J) style frames.
        speed: (M,) planar speed of the base [m/s].
        standing_row: First row of the last clip.
    """

    def __init__(self, spec: RobotSpec, library: MotionLibrary) -> None:
        """Line up the clips and infer their actions, which takes a while."""
        self.states: ClipStates = clip_states(library)
        self.actions = infer_actions(spec, self.states, spec.action_scale)
        self.previous_actions = previous_actions(self.states, self.actions)
        state = RobotState.from_generalized(self.states.qpos, self.states.qvel)
        self.frames = style_frame(state)
        self.speed = state.lin_vel_b[:, :2].norm(dim=-1)
        self.standing_row = int(self.states.first[-1])
        self._tolerances = spec.tracking
        self._terms = style_terms(self.actions.shape[1])

    @property
    def width(self) -> int:
        """Columns of :meth:`lookahead`."""
        return len(LOOKAHEAD) * self.frames.shape[1]

    def lookahead(self, rows: torch.Tensor) -> torch.Tensor:
        """(N, width) style frames ``LOOKAHEAD`` steps after ``rows`` (N,).

        Beyond the end of a clip its last frame is repeated.
        """
        last = self.states.last[rows]
        frames = [self.frames[torch.minimum(rows + steps, last)] for steps in LOOKAHEAD]
        return torch.cat(frames, dim=-1)

    def compare(self, state: RobotState, rows: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        """Compare N robots with the reference at ``rows`` (N,).

        Returns:
            (N,) reward in [0, 1], and (N,) bool, whether the error of the joints, of the height or
            of the tilt exceeds the robot's tolerance.
        """
        errors = (style_frame(state) - self.frames[rows]).split(
            [term.size for term in self._terms], dim=-1
        )
        squared = {
            term.name: error.square().sum(dim=-1)
            for term, error in zip(self._terms, errors, strict=True)
        }
        reward = torch.zeros_like(squared["base_height"])
        for name, (weight, sharpness) in TERMS.items():
            reward = reward + weight * torch.exp(-sharpness * squared[name])
        tolerances = self._tolerances
        joints = squared["joint_pos"] / state.joint_pos.shape[1] > tolerances.joint_error**2
        height = squared["base_height"] > tolerances.height_error**2
        tilt = squared["projected_gravity"] > tolerances.tilt_error**2
        return reward, joints | height | tilt
