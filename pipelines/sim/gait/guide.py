"""What guides an expert on two legs: a gait clock in its view, a reference under its actions, and
its second half of the cycle seen in the mirror.

The policy stays a plain network. It only ever sees the first foot swing, so that what it learns of
one leg holds for the other. The low level that imitates its clips sees no command, and keeps the
clock in its own memory.
"""

from __future__ import annotations

from typing import Any

import torch

from lacoloco.datasets.rotations import rotate
from lacoloco.pipelines.masking import pick, put
from lacoloco.pipelines.sim.gait.clock import ASKED_SPEED, GaitClock
from lacoloco.pipelines.sim.gait.mirror import Mirror
from lacoloco.pipelines.sim.gait.reach_servo import ReachServo
from lacoloco.pipelines.sim.gait.stride import StrideReference
from lacoloco.pipelines.sim.kinematics import PointChain
from lacoloco.pipelines.sim.physics import CONTROL_DT
from lacoloco.pipelines.sim.state import RobotState, Term
from lacoloco.robots.errors import RobotError
from lacoloco.robots.spec import RobotSpec

CLOCK_TERM = Term("gait_clock", 3, "1", "phase")
SMOOTHING_S = 0.3
"""Time constant of the mean velocity [s]: the base sways within a step."""


class GaitGuide:
    """The guide of N worlds.

    Attributes:
        clock: The gait clock.
        joint_pos: (N, J) reference of this control step [rad].
        mean_velocity: (N, 3) planar velocity and yaw rate in the base frame, low-pass filtered
            [m/s, m/s, rad/s].
        foot_pos: (N, 2, 3) the feet, world [m].
        foot_vel: (N, 2, 3) their mean velocity over the control step [m/s].
        pitch_columns: Hip, knee and ankle of both legs.
        sideways_columns: The legs' other joints.
        upper_columns: The joints of no leg.
    """

    def __init__(
        self,
        spec: RobotSpec,
        num_worlds: int,
        terms: tuple[Term, ...],
        device: torch.device,
        *,
        reaches: bool,
    ) -> None:
        """Read the gait, the legs and the mirror from the robot.

        Args:
            spec: The robot.
            num_worlds: N.
            terms: Layout of the policy's view without the clock.
            device: Where the worlds are.
            reaches: Whether the end effector is led to the target that the task commands.

        Raises:
            RobotError: It has no ``[gait]``, or legs that cannot walk this way.
        """
        if spec.gait is None or len(spec.feet) != 2:
            raise RobotError(
                f"robot {spec.name!r}: a task with `gait` needs a table [gait] and two feet"
            )
        self.clock = GaitClock(spec.gait, num_worlds, device)
        self._stride = StrideReference(spec, device)
        self._height = spec.default_height()
        self._mirror = Mirror(spec, terms, device)
        self._servo = ReachServo(spec, num_worlds, device) if reaches else None
        self._feet = [PointChain(spec, body, device=device) for body in spec.feet]
        self.mean_velocity = torch.zeros(num_worlds, 3, device=device)
        self.foot_pos = torch.zeros(num_worlds, 2, 3, device=device)
        self.foot_vel = torch.zeros_like(self.foot_pos)
        self.joint_pos = self._stride.default.repeat(num_worlds, 1)
        legs = {j for chain in self._feet for j in chain.joints}
        pitch = {j for leg in self._stride.legs for j in leg.pitch}
        self.pitch_columns, self.sideways_columns = sorted(pitch), sorted(legs - pitch)
        self.upper_columns = sorted(set(range(spec.num_joints)) - legs)

    def observe(self, observation: torch.Tensor) -> torch.Tensor:
        """The policy's view (N, width): mirrored in the second half of the cycle, with the
        clock.
        """
        flipped = self.clock.second_half()[:, None]
        seen = torch.where(flipped, self._mirror.observation(observation), observation)
        return torch.cat((seen, self.clock.observe()), dim=-1)

    def actual(self, action: torch.Tensor) -> torch.Tensor:
        """(N, J) the policy's actions, mirrored back."""
        flipped = self.clock.second_half()[:, None]
        return torch.where(flipped, self._mirror.joints(action), action)

    def advance(
        self, state: RobotState, qpos: torch.Tensor, command: torch.Tensor, force: torch.Tensor
    ) -> None:
        """Begin a control step: move the clock on and find the reference.

        Args:
            state: The robots before the step.
            qpos: (N, 7 + J) their positions.
            command: (N, 3) velocity or, for a task that reaches, target.
            force: (N, 2) contact forces of the feet [N].
        """
        asked = command if self._servo is None else torch.zeros_like(command)
        speed = torch.linalg.vector_norm(self.mean_velocity[:, :2], dim=1)
        tilt = torch.linalg.vector_norm(state.gravity_b[:, :2], dim=1)
        moves = torch.linalg.vector_norm(asked, dim=1) > ASKED_SPEED
        self.clock.advance(moves, speed, tilt, force)
        self.joint_pos = self._stride(self.clock, asked)
        if self._servo is not None:
            self._servo.advance(qpos, command)
            self.joint_pos[:, self._servo.joints] = self._servo.joint_pos

    def lead_from(self, joint_pos: torch.Tensor) -> None:
        """Lead the arm on from a reference (N, J) [rad], where a task reaches.

        An arm that somebody else moves does not follow its reference, which would then run away
        from it.
        """
        if self._servo is not None:
            self._servo.joint_pos = joint_pos[:, self._servo.joints]

    def update(self, state: RobotState, qpos: torch.Tensor) -> None:
        """End a control step: measure what the rewards read."""
        share = CONTROL_DT / SMOOTHING_S
        self.mean_velocity = self.mean_velocity + share * (_planar(state) - self.mean_velocity)
        now = torch.stack([chain(qpos) for chain in self._feet], dim=1)
        self.foot_vel = (now - self.foot_pos) / CONTROL_DT
        self.foot_pos = now

    def reset(
        self, worlds: torch.Tensor, state: RobotState, qpos: torch.Tensor, phase: torch.Tensor
    ) -> None:
        """Start ``worlds`` anew from the states that all are in now, the clocks at rest at
        ``phase`` (K,).
        """
        self.clock.reset(worlds, phase, torch.zeros_like(phase, dtype=torch.bool))
        self.reset_history(worlds, state, qpos)

    def reset_history(self, worlds: torch.Tensor, state: RobotState, qpos: torch.Tensor) -> None:
        """Forget how ``worlds`` moved before the states that all are in now."""
        feet = torch.stack([chain(qpos) for chain in self._feet], dim=1)
        for name, fresh in (
            ("mean_velocity", _planar(state)),
            ("foot_pos", feet),
            ("foot_vel", torch.zeros_like(feet)),
        ):
            values = getattr(self, name).clone()
            put(values, worlds, pick(fresh, worlds))
            setattr(self, name, values)
        if self._servo is not None:
            self._servo.reset_joints(worlds, qpos)

    def walking_start(
        self, worlds: torch.Tensor, qpos: torch.Tensor, command: torch.Tensor
    ) -> tuple[torch.Tensor, torch.Tensor]:
        """Let the clocks of ``worlds`` run: positions (K, 7 + J) and velocities (K, 6 + J) inside
        the gait that ``command`` (N, 3) asks for, where the robots of ``qpos`` (N, 7 + J) are.
        """
        clock = self.clock
        phase = pick(clock.phase, worlds)
        clock.reset(worlds, phase, torch.ones_like(phase, dtype=torch.bool))
        now, kept = self._stride(clock, command), clock.phase
        clock.phase = (kept + CONTROL_DT / clock.gait.period) % 1.0
        joint_vel = (self._stride(clock, command) - now) / CONTROL_DT
        clock.phase = kept
        height = torch.full_like(qpos[:, :1], self._height)
        ahead = rotate(qpos[:, 3:7], command * command.new_tensor((1.0, 1.0, 0.0)))
        turning = command * command.new_tensor((0.0, 0.0, 1.0))
        positions = torch.cat((qpos[:, :2], height, qpos[:, 3:7], now), dim=1)
        velocities = torch.cat((ahead, turning, joint_vel), dim=1)
        return pick(positions, worlds), pick(velocities, worlds)

    def state_dict(self) -> dict[str, Any]:
        """Everything that makes the next step what it is."""
        kept: dict[str, Any] = {name: getattr(self, name) for name in _STATE}
        kept["clock"] = self.clock.state_dict()
        if self._servo is not None:
            kept["servo"] = self._servo.joint_pos
        return kept

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Restore :meth:`state_dict`."""
        self.clock.load_state_dict(state["clock"])
        for name in _STATE:
            setattr(self, name, state[name].to(self.joint_pos.device))
        if self._servo is not None:
            self._servo.joint_pos = state["servo"].to(self.joint_pos.device)


_STATE = ("joint_pos", "mean_velocity", "foot_pos", "foot_vel")


def _planar(state: RobotState) -> torch.Tensor:
    """(N, 3) forward, lateral and yaw velocity in the base frame."""
    return torch.cat((state.lin_vel_b[:, :2], state.ang_vel_b[:, 2:]), dim=1)
