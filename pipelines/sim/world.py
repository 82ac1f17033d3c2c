"""What rewards and constraints may read: the part of an environment that describes the step just
taken.
"""

from __future__ import annotations

from typing import Protocol

import torch

from lacoloco.pipelines.sim.contact_timer import FootTimer
from lacoloco.pipelines.sim.gait.guide import GaitGuide
from lacoloco.pipelines.sim.physics import Physics
from lacoloco.pipelines.sim.state import RobotState


class World(Protocol):
    """N robots after a control step.

    Attributes:
        physics: contact forces and torques of the step.
        state: the robots now.
        previous: the robots before the step.
        action: (N, J) raw actions of the step.
        previous_action: (N, J) raw actions of the step before.
        command: (N, 3) what the task asks for.
        feet: contact timing.
        default_joint_pos: (J,) default pose [rad].
        abduction_columns: the joints that move a leg sideways.
        previous_target_error: (N,) distance from the target before the step [m], in tasks with a
            target.
    """

    physics: Physics
    state: RobotState
    previous: RobotState
    action: torch.Tensor
    previous_action: torch.Tensor
    command: torch.Tensor
    feet: FootTimer
    default_joint_pos: torch.Tensor
    abduction_columns: torch.Tensor
    previous_target_error: torch.Tensor

    @property
    def gait(self) -> GaitGuide:
        """Clock and reference, in tasks with a gait."""

    def end_effector(self) -> torch.Tensor:
        """(N, 3) world position of the end effector [m]."""

    def target_error(self) -> torch.Tensor:
        """(N,) distance of the end effector from its target [m]."""

    def command_speed(self) -> torch.Tensor:
        """(N,) norm of the commanded velocity."""
