"""What the robot is doing, in the frames the paper observes it in, and the layout of every
observation.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import torch

from lacoloco.datasets.rotations import rotate_inverse
from lacoloco.robots.numbers import ObservationNoise

if TYPE_CHECKING:
    from lacoloco.datasets.motion_library import MotionFrames

TARGET_DIM = 3
CLEAN = ObservationNoise()


@dataclass(frozen=True)
class Term:
    """One contiguous slice of an observation: name, width, unit, frame, training noise (uniform,
    +-noise), and how many control steps ago it was read.
    """

    name: str
    size: int
    unit: str
    frame: str
    noise: float = 0.0
    steps_ago: int = 0


@dataclass
class RobotState:
    """The state of N robots (float32).

    Attributes:
        root_pos: (N, 3) world position of the base [m].
        root_quat: (N, 4) base-to-world rotation, wxyz.
        lin_vel_b: (N, 3) linear velocity of the base, base frame [m/s].
        ang_vel_b: (N, 3) angular velocity of the base, base frame [rad/s].
        joint_pos: (N, J) [rad].
        joint_vel: (N, J) [rad/s].
    """

    root_pos: torch.Tensor
    root_quat: torch.Tensor
    lin_vel_b: torch.Tensor
    ang_vel_b: torch.Tensor
    joint_pos: torch.Tensor
    joint_vel: torch.Tensor

    @classmethod
    def from_generalized(cls, qpos: torch.Tensor, qvel: torch.Tensor) -> RobotState:
        """Split MuJoCo's (N, 7 + J) and (N, 6 + J) into base-frame quantities (root linear velocity
        comes in world).
        """
        quat = qpos[:, 3:7]
        return cls(
            qpos[:, :3],
            quat,
            rotate_inverse(quat, qvel[:, :3]),
            qvel[:, 3:6],
            qpos[:, 7:],
            qvel[:, 6:],
        )

    @classmethod
    def from_motion(cls, frames: MotionFrames) -> RobotState:
        """The same for frames of clips, so that demonstrations go through the very code that the
        agent does.
        """
        return cls(
            frames.root_pos,
            frames.root_quat,
            frames.root_lin_vel_b,
            frames.root_ang_vel_b,
            frames.joint_pos,
            frames.joint_vel,
        )

    @property
    def gravity_b(self) -> torch.Tensor:
        """(N, 3) unit gravity direction in the base frame; (0, 0, -1) when level."""
        down = torch.zeros_like(self.root_pos)
        down[:, 2] = -1.0
        return rotate_inverse(self.root_quat, down)


def style_frame(state: RobotState) -> torch.Tensor:
    """(N, 10 + 2J) the discriminator's view of one instant, clean (paper, "Observations"); see
    :func:`style_terms`.
    """
    parts = (
        state.root_pos[:, 2:3],
        state.gravity_b,
        state.lin_vel_b,
        state.ang_vel_b,
        state.joint_pos,
        state.joint_vel,
    )
    return torch.cat(parts, dim=-1)


def style_terms(joints: int, noise: ObservationNoise = CLEAN) -> tuple[Term, ...]:
    """Layout of :func:`style_frame`; the noise is what the *policy's* copy receives in training."""
    return (
        Term("base_height", 1, "m", "world", noise.base_height),
        Term("projected_gravity", 3, "1", "base", noise.projected_gravity),
        Term("base_lin_vel", 3, "m/s", "base", noise.base_lin_vel),
        Term("base_ang_vel", 3, "rad/s", "base", noise.base_ang_vel),
        Term("joint_pos", joints, "rad", "joint", noise.joint_pos),
        Term("joint_vel", joints, "rad/s", "joint", noise.joint_vel),
    )


def policy_terms(
    joints: int, noise: ObservationNoise = CLEAN, command: Term | None = None, memory: int = 0
) -> tuple[Term, ...]:
    """Layout of the low-level policy's observation: the style frame, the last action, ``memory``
    outputs that came with it, a command if the task has one.
    """
    terms = (*style_terms(joints, noise), Term("last_action", joints, "1", "joint"))
    if memory:
        terms = (*terms, Term("last_memory", memory, "1", "gait clock"))
    return terms if command is None else (*terms, command)


def high_level_terms(
    joints: int,
    latent_dim: int,
    noise: ObservationNoise = CLEAN,
    command: Term | None = None,
) -> tuple[Term, ...]:
    """Layout of the high-level policy's observation: style frame, command (a target in the base
    frame unless another is given), last latent.
    """
    asked = command or Term("target", TARGET_DIM, "m", "base")
    return (*style_terms(joints, noise), asked, Term("last_latent", latent_dim, "1", "latent"))


def width(terms: tuple[Term, ...]) -> int:
    """Number of columns of a layout."""
    return sum(term.size for term in terms)


def noise_scale(terms: tuple[Term, ...]) -> torch.Tensor:
    """(width,) half-range of the uniform training noise of every column."""
    return torch.cat([torch.full((term.size,), term.noise) for term in terms])


def layout(terms: tuple[Term, ...]) -> list[dict[str, object]]:
    """The layout as plain data with [start, stop) slices, for the metadata of policies. A term that
    was not read in this control step says ``steps_ago``.
    """
    rows: list[dict[str, object]] = []
    start = 0
    for term in terms:
        rows.append(
            {
                "name": term.name,
                "slice": [start, start + term.size],
                "unit": term.unit,
                "frame": term.frame,
                **({"steps_ago": term.steps_ago} if term.steps_ago else {}),
            }
        )
        start += term.size
    return rows
