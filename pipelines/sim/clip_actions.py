"""Actions for clips that have none, and a policy that begins with them.

A clip says how a robot moved, not what its motors were asked for. Both engines can answer that: put
a world into every recorded state, ask for joint targets, and correct them until the next recorded
state comes out (inverse dynamics by simulation). A policy fitted to those actions goes on in
whatever motion it finds itself in, and adversarial training starts from there instead of from a
robot that has to discover walking by accident.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch

from lacoloco.datasets import rotations
from lacoloco.datasets.motion_library import MotionLibrary
from lacoloco.pipelines.learn.skill_embedding import FlattenedClips
from lacoloco.pipelines.sim.engines import make_physics
from lacoloco.pipelines.sim.physics import CONTROL_DT, Physics, PhysicsRequest
from lacoloco.pipelines.sim.state import RobotState, style_frame
from lacoloco.robots.spec import RobotSpec

ITERATIONS = 60
"""In the air 6 are enough; where a leg is loaded the answer is slower, and after 6 the targets are
still 0.14 rad (rms) off.
"""


@dataclass(frozen=True)
class ClipStates:
    """All clips at the control rate, one after the other.

    Attributes:
        qpos: (M, 7 + J) generalised positions.
        qvel: (M, 6 + J) generalised velocities.
        first: (clips,) row of the first state of every clip.
        last: (M,) row of the last state of the clip that a row belongs to.
        targets: (M, J) where the motors were asked to go from each state to the next [rad], NaN
            where nobody knows.
        memory: (M, 3) where the expert's gait clock stood, NaN likewise.
    """

    qpos: torch.Tensor
    qvel: torch.Tensor
    first: torch.Tensor
    last: torch.Tensor
    targets: torch.Tensor
    memory: torch.Tensor

    @property
    def remaining(self) -> torch.Tensor:
        """(M,) control steps from each row to the last one of its clip."""
        return self.last - torch.arange(len(self.last), device=self.last.device)

    @property
    def before(self) -> torch.Tensor:
        """(M,) row of the state one control step earlier; a clip's first follows itself."""
        rows = torch.arange(len(self.last), device=self.last.device) - 1
        rows[self.first] = self.first
        return rows

    def flattened(self) -> FlattenedClips:
        """The style frames, as the skill embedding looks at them."""
        return FlattenedClips(
            style_frame(RobotState.from_generalized(self.qpos, self.qvel)), self.last
        )

    def rows(self, clips: torch.Tensor, times: torch.Tensor) -> torch.Tensor:
        """(n,) rows nearest to ``times`` [s] in the clips with numbers ``clips``, (n,) each."""
        first = self.first[clips]
        return torch.minimum(first + (times / CONTROL_DT).round().long(), self.last[first])


def clip_states(library: MotionLibrary) -> ClipStates:
    """Line up the clips of a library: recorded states where a clip's rate is the control rate,
    blended ones elsewhere.
    """
    lengths = (library.durations / CONTROL_DT + 1e-3).long() + 1
    ends = lengths.cumsum(0)
    first, last = ends - lengths, torch.repeat_interleave(ends - 1, lengths)
    clips = torch.repeat_interleave(torch.arange(len(library), device=library.device), lengths)
    within = torch.arange(len(clips), device=library.device) - first[clips]
    frames = library.frames(clips, within * CONTROL_DT)
    linear = rotations.rotate(frames.root_quat, frames.root_lin_vel_b)
    qpos = torch.cat((frames.root_pos, frames.root_quat, frames.joint_pos), dim=1)
    qvel = torch.cat((linear, frames.root_ang_vel_b, frames.joint_vel), dim=1)
    moments = (clips, within * CONTROL_DT, CONTROL_DT)
    targets, memory = library.joint_targets(*moments), library.gait_memory(*moments)
    return ClipStates(qpos, qvel, first, last, targets, memory)


def infer_actions(spec: RobotSpec, states: ClipStates, action_scale: float) -> torch.Tensor:
    """(M, J) raw actions that take every state to the next one of its clip; zero where there is
    none.

    Those that a robot performed the clip with are taken as they are: inferred ones are 0.06 rad
    (rms) off for a trotting Solo12. The world is the model's own, without randomisation.
    """
    device = states.qpos.device
    moving = torch.arange(len(states.qpos), device=device) < states.last
    known = states.targets.isfinite().all(dim=1) & moving
    default = torch.tensor(spec.default_joint_pos, device=device)
    actions = torch.where(known[:, None], (states.targets - default) / action_scale, 0.0)
    chosen = torch.nonzero(moving & ~known).flatten()
    if not len(chosen):
        return actions
    physics = make_physics(PhysicsRequest(spec, min(1024, len(chosen))), str(device))
    for rows in chosen.split(physics.num_worlds):
        actions[rows] = _solve(spec, physics, states, rows, action_scale)
    return actions


def previous_actions(states: ClipStates, actions: torch.Tensor) -> torch.Tensor:
    """(M, J) the actions one step earlier; a clip's first is taken to have followed itself."""
    earlier = torch.roll(actions, 1, dims=0)
    earlier[states.first] = actions[states.first]
    return earlier


def with_memory(
    states: ClipStates, actions: torch.Tensor, memory: int
) -> tuple[torch.Tensor, torch.Tensor]:
    """(M, J + memory) actions (M, J) with where the clock stands after them, NaN where nobody
    knows; and the actions one step earlier with where it stood then, 0 where nobody knows.
    """
    now = states.memory[:, :memory]
    rows = torch.arange(len(now), device=now.device)
    after = now[torch.minimum(rows + 1, states.last)]
    previous = torch.cat((previous_actions(states, actions), now.nan_to_num()), dim=1)
    return torch.cat((actions, after), dim=1), previous


def _solve(
    spec: RobotSpec, physics: Physics, states: ClipStates, rows: torch.Tensor, action_scale: float
) -> torch.Tensor:
    """(K, J) actions for the moments ``rows``, worlds beyond K idle in the last state."""
    padded = torch.cat((rows, rows[-1:].expand(physics.num_worlds - len(rows))))
    worlds = torch.arange(physics.num_worlds, device=rows.device)
    default = torch.tensor(spec.default_joint_pos, device=rows.device)
    lead = torch.tensor(spec.damping, device=rows.device) / torch.tensor(
        spec.stiffness, device=rows.device
    )
    wanted_q, wanted_v = states.qpos[padded + 1, 7:], states.qvel[padded + 1, 6:]
    target = wanted_q + lead * wanted_v
    gains, bound = spec.inverse_dynamics, spec.inverse_dynamics.largest_action
    for _ in range(ITERATIONS):
        physics.reset(worlds, states.qpos[padded], states.qvel[padded])
        physics.step(target)
        off_q, off_v = wanted_q - physics.qpos[:, 7:], wanted_v - physics.qvel[:, 6:]
        correction = gains.position_gain * off_q + gains.velocity_gain * off_v
        target = target + 0.7 * correction
    return ((target - default) / action_scale).clamp(-bound, bound)[: len(rows)]
