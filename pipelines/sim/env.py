"""N robots in N worlds under one task: actions in, clean pre-reset transitions out. All torch, no
loop over worlds.

An environment never resets itself: :meth:`LeggedEnv.step` describes the step as it ended, the
caller decides what to keep of it, then calls :meth:`LeggedEnv.reset`. So no transition, value or
reward can ever be taken from the wrong side of a reset (the original takes them after it).
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import torch

from lacoloco.pipelines.masking import pick, put, select
from lacoloco.pipelines.sim import state as layouts
from lacoloco.pipelines.sim.commands import uniform
from lacoloco.pipelines.sim.constraints import CONSTRAINTS, Limit
from lacoloco.pipelines.sim.contact_timer import FootTimer
from lacoloco.pipelines.sim.disturbances.sensors import make_sensors
from lacoloco.pipelines.sim.engines import make_physics
from lacoloco.pipelines.sim.env_state import restore_state, state_of
from lacoloco.pipelines.sim.gait.clock import ASKED_SPEED
from lacoloco.pipelines.sim.gait.guide import CLOCK_TERM, GaitGuide
from lacoloco.pipelines.sim.initial_states import StandingStarts, clip_starts
from lacoloco.pipelines.sim.kinematics import EndEffectorChain
from lacoloco.pipelines.sim.observation import FULL, Observation
from lacoloco.pipelines.sim.physics import CONTROL_DT, Physics, PhysicsRequest
from lacoloco.pipelines.sim.randomisation import draw_parameters
from lacoloco.pipelines.sim.state import RobotState, Term, style_frame
from lacoloco.pipelines.sim.step import Step
from lacoloco.pipelines.sim.tasks import Task
from lacoloco.pipelines.sim.views import View, look, reading
from lacoloco.robots.spec import RobotSpec

if TYPE_CHECKING:
    from lacoloco.datasets.motion_library import MotionLibrary
    from lacoloco.pipelines.sim.readings import Readings

FALL_FORCE = 1.0
"""Newtons on a fall body that end an episode (the original's code)."""


class LeggedEnv:
    """A robot under a task; ``state``, ``previous``, ``action`` and ``command`` are what the terms
    read.
    """

    def __init__(
        self,
        spec: RobotSpec,
        task: Task,
        num_worlds: int,
        *,
        seed: int,
        device: str = "cpu",
        motions: MotionLibrary | None = None,
        physics: Physics | None = None,
        observation: Observation = FULL,
    ) -> None:
        """Build the worlds, draw their parameters and start every episode; :meth:`observe` will
        show what ``observation`` says.
        """
        self.spec, self.task, self.num_worlds, self.motions = spec, task, num_worlds, motions
        limits, disturbed = task.training_limits, task.disturbances
        request = PhysicsRequest(spec, num_worlds, limits, disturbances=disturbed, seed=seed)
        self.physics = physics or make_physics(request, device)
        self.device = self.physics.device
        self.generator = torch.Generator(self.device).manual_seed(seed)
        self._chain = EndEffectorChain(spec, self.device)
        joints = len(spec.joint_names)
        self.default_joint_pos = torch.tensor(spec.default_joint_pos, device=self.device)
        sideways = [spec.joint_names.index(name) for name in spec.abduction_joints]
        self.abduction_columns = torch.tensor(sideways, dtype=torch.long, device=self.device)
        self.num_actions = joints + task.memory
        self.guide: GaitGuide | None = None
        if task.gait:
            terms = self.all_terms
            self.guide = GaitGuide(spec, num_worlds, terms, self.device, reaches=task.has_target)
        self._starts = StandingStarts(spec, task.reset, self.generator, self.device)
        self._falls = slice(
            0, len(self.physics.monitored) if task.fall_on_undesired else len(spec.fall_bodies)
        )
        self._limits: dict[str, Limit] = {
            c.name: c.limit
            if isinstance(c.limit, float)
            else torch.tensor(c.limit, device=self.device)
            for c in task.constraints
        }
        self.noise_scale = layouts.noise_scale(self.all_terms).to(self.device)
        # What a trainer may give each world for itself; the same everywhere until then.
        self.noise = torch.full((num_worlds, 1), task.noise, device=self.device)
        self.episode_steps = torch.full((num_worlds,), task.episode_steps, device=self.device)
        self.clip_share = torch.full((num_worlds,), task.reset.clip_share, device=self.device)
        self.feet = FootTimer(num_worlds, len(spec.feet), self.device)
        self.steps = torch.zeros(num_worlds, dtype=torch.long, device=self.device)
        self.action = torch.zeros(num_worlds, self.num_actions, device=self.device)
        self.joint_target = self.default_joint_pos.repeat(num_worlds, 1)
        self.command = torch.zeros(num_worlds, 3, device=self.device)
        self._resample_at = torch.zeros_like(self.steps)
        self._push_at = torch.zeros_like(self.steps)
        self.diverged_total = torch.zeros((), dtype=torch.long, device=self.device)
        self.parameters = draw_parameters(
            task.randomisation, num_worlds, len(spec.feet), self.generator
        )
        self.physics.set_parameters(self.parameters)
        self._end_effector: torch.Tensor | None = None
        self.sensors = make_sensors(disturbed, self.physics, self.noise_scale, seed)
        self.readings: Readings | None = None
        self.view: View | None = None
        self.seed = seed
        self._read()
        self.reset(torch.ones(num_worlds, dtype=torch.bool, device=self.device))
        if observation != FULL:
            self.view = View(self, self.all_terms, observation)

    @property
    def terms(self) -> tuple[Term, ...]:
        """Layout of :meth:`observe`."""
        if self.view is not None:
            return self.view.terms
        return self.all_terms if self.guide is None else (*self.all_terms, CLOCK_TERM)

    @property
    def all_terms(self) -> tuple[Term, ...]:
        """Layout of all that policies may see of now, without a gait's clock."""
        command = None if self.task.command is None else self.task.command.term
        joints, noise = self.spec.num_joints, self.spec.observation_noise
        return layouts.policy_terms(joints, noise, command, self.task.memory)

    @property
    def gait(self) -> GaitGuide:
        """The guide of a task with a gait."""
        assert self.guide is not None, "the task has no gait"
        return self.guide

    def step(self, action: torch.Tensor, instead: torch.Tensor | None = None) -> Step:
        """Apply raw actions (N, A) for one control step: joint targets = default pose, or the
        reference of a gait, + action scale x action.

        Args:
            action: Raw actions of the J joints; a task's memory after them moves nothing.
            instead: (N, J) joint targets to apply [rad] while ``joint_target`` says what the
                actions would have asked for; NaN where they are applied.
        """
        reference = self.default_joint_pos
        if self.guide is not None:
            action = self.guide.actual(action)
            force = self.physics.foot_force[:, -1]
            self.guide.advance(self.state, self.physics.qpos, self.command, force)
            reference = self.guide.joint_pos
        self.previous, self.previous_action, self.action = self.state, self.action, action
        if self.task.has_target:
            self.previous_target_error = self.target_error()
        moves = action[:, : len(self.default_joint_pos)]
        self.joint_target = reference + self.task.action_scale * moves
        applied = self.joint_target
        if instead is not None:
            applied = torch.where(instead.isnan(), applied, instead)
        self.physics.step(applied)
        self._read()
        if self.sensors is not None:
            self.sensors.update()
        if self.guide is not None:
            self.guide.update(self.state, self.physics.qpos)
        self.steps += 1
        self.feet.update(self.physics.foot_force[:, -1])
        diverged = self.physics.diverged
        self.diverged_total += diverged.sum()
        fell = (self.physics.body_force[:, self._falls] > FALL_FORCE).any(dim=-1) | diverged
        if self.task.fall_tilt is not None:
            fell |= self.state.gravity_b[:, 2] > -math.cos(self.task.fall_tilt)
        if self.task.fall_height is not None:
            fell |= self.state.root_pos[:, 2] < self.task.fall_height
        reward = self._reward()
        violations = {
            name: CONSTRAINTS[name].function(self, limit) for name, limit in self._limits.items()
        }
        # A broken world may report any force, and the constraints' running scales over all worlds
        # would keep it.
        reward = reward.masked_fill(diverged, 0.0)
        violations = {
            name: margin.masked_fill(diverged[:, None], 0.0) for name, margin in violations.items()
        }
        timed_out = (self.steps >= self.episode_steps) & ~fell
        step = Step(self.frame(), reward, fell, timed_out, ~diverged, violations)
        self._push()
        self._resample()
        if self.readings is not None:
            self.readings.advance(reading(self), self.seen(on_board=True))
        return step

    def frame(self) -> torch.Tensor:
        """(N, 10 + 2J) clean style frame of the current state."""
        return style_frame(self.state)

    def observe(self) -> torch.Tensor:
        """(N, width of ``terms``) the policy's view, with the task's noise: style frame, last
        action and command, or what the environment's observation makes of them.
        """
        return look(self) if self.view is None else self.view()

    def seen(self, *, on_board: bool = False) -> RobotState:
        """The state as the sensors give it, those ``on_board`` alone: without motion capture."""
        if self.sensors is None:
            return self.state
        return (self.sensors.reading_on_board if on_board else self.sensors.reading)(self.state)

    def reset(self, mask: torch.Tensor) -> None:
        """Start new episodes in the worlds of ``mask`` (N,) bool."""
        worlds = select(mask)
        if not len(worlds):
            return
        qpos, qvel = self._starts.anywhere(self.task.reset, len(worlds), self.generator)
        action = torch.zeros(len(worlds), self.num_actions, device=self.device)
        if self.motions is not None and self.task.reset.clip_share > 0.0:
            chosen = select(self._uniform(len(worlds)) < pick(self.clip_share, worlds))
            if len(chosen):
                start = clip_starts(self.motions, len(chosen), self.generator)
                asked = (start.joint_target - self.default_joint_pos) / self.task.action_scale
                before = torch.cat((asked, start.memory[:, : self.task.memory]), dim=1)
                values = (start.qpos, start.qvel, before.nan_to_num())
                for target, value in zip((qpos, qvel, action), values, strict=True):
                    put(target, chosen, value)
        self.physics.reset(worlds, qpos, qvel)
        self._read(worlds)
        put(self.steps, worlds, 0)
        self.action = self.action.clone()
        put(self.action, worlds, action)
        self.feet.reset(worlds)
        if self.task.command is not None:
            put(self.command, worlds, self._commands(len(worlds)))
        put(self._resample_at, worlds, self._later(self.task.resample_s, len(worlds)))
        put(
            self._push_at, worlds, self._later(self.task.randomisation.push_interval_s, len(worlds))
        )
        if self.guide is not None:
            self._start_gait(self.guide, worlds)
        self._restart_readings(worlds)

    def start_from(
        self, worlds: torch.Tensor, qpos: torch.Tensor, qvel: torch.Tensor, action: torch.Tensor
    ) -> None:
        """Put worlds that have just been reset into other states: rows (K, 7 + J), (K, 6 + J), and
        last actions (K, A).
        """
        self.physics.reset(worlds, qpos, qvel)
        self._read(worlds)
        if self.guide is not None:
            self.guide.reset_history(worlds, self.state, self.physics.qpos)
        self.action = self.action.clone()
        put(self.action, worlds, action)
        self._restart_readings(worlds)

    def redraw(self, mask: torch.Tensor) -> None:
        """Put other robots on other floors into the worlds of ``mask`` (N,) bool, where they are
        and as they move.

        Costs four tenths of a step for any number of them, so call it now and then, for the worlds
        that began anew since the last call.
        """
        others = draw_parameters(
            self.task.randomisation, self.num_worlds, len(self.spec.feet), self.generator
        )
        self.parameters = self.parameters.replaced(mask, others)
        self.physics.set_parameters(self.parameters)

    def stagger(self) -> None:
        """Spread the ages of the running episodes, so that time-outs do not all fall into the same
        iteration.
        """
        self.steps = (self._uniform(self.num_worlds) * self.episode_steps).long()

    def stagger_by(self, hold: int) -> None:
        """Spread the ages likewise, each a multiple of ``hold`` control steps, so that time-outs
        stay between two decisions.
        """
        shape = (self.num_worlds,)
        ages = torch.randint(
            0, self.task.episode_steps // hold, shape, generator=self.generator, device=self.device
        )
        self.steps = hold * ages

    def set_noise_free(self, mask: torch.Tensor) -> None:
        """Observe the worlds of ``mask`` (N,) bool without noise from now on."""
        self.noise[mask] = 0.0

    def set_episodes(self, mask: torch.Tensor, seconds: float, clip_share: float) -> None:
        """Give the worlds of ``mask`` (N,) bool episodes of their own.

        Args:
            mask: Which worlds.
            seconds: Time-out [s].
            clip_share: Share of their resets that start inside a clip.
        """
        worlds = select(mask)
        put(self.episode_steps, worlds, round(seconds / CONTROL_DT))
        put(self.clip_share, worlds, clip_share)

    def end_effector(self) -> torch.Tensor:
        """(N, 3) world position of the end effector [m]; computed once per state."""
        if self._end_effector is None:
            self._end_effector = self._chain(self.physics.qpos)
        return self._end_effector

    def target_error(self) -> torch.Tensor:
        """(N,) distance of the end effector from its target [m]."""
        return torch.linalg.vector_norm(self.end_effector() - self.command, dim=-1)

    def command_speed(self) -> torch.Tensor:
        """(N,) norm of the commanded velocity (m/s and rad/s taken alike)."""
        return torch.linalg.vector_norm(self.command, dim=-1)

    def state_dict(self) -> dict[str, Any]:
        """Everything that makes the next step what it is."""
        return state_of(self)

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Restore :meth:`state_dict`."""
        restore_state(self, state)

    def _restart_readings(self, worlds: torch.Tensor) -> None:
        if self.readings is not None:
            self.readings.restart(worlds, reading(self), self.seen(on_board=True))

    def _start_gait(self, guide: GaitGuide, worlds: torch.Tensor) -> None:
        """Rest the clocks of ``worlds``, and put a share of those told to walk into the gait."""
        guide.reset(worlds, self.state, self.physics.qpos, self._uniform(len(worlds)))
        if self.task.reset.gait_share == 0.0:
            return
        chosen = (self._uniform(len(worlds)) < self.task.reset.gait_share) & (
            pick(self.command_speed(), worlds) > ASKED_SPEED
        )
        walking = worlds & chosen if worlds.dtype == torch.bool else worlds[chosen]
        if not len(walking):
            return
        start = guide.walking_start(walking, self.physics.qpos, self.command)
        self.physics.reset(walking, *start)
        self._read(walking)
        guide.reset_history(walking, self.state, self.physics.qpos)

    def _read(self, restarted: torch.Tensor | None = None) -> None:
        self.state = RobotState.from_generalized(self.physics.qpos, self.physics.qvel)
        self._end_effector = None
        if self.sensors is not None and restarted is not None:
            self.sensors.restart(restarted)

    def _reward(self) -> torch.Tensor:
        total = torch.zeros(self.num_worlds, device=self.device)
        for term in self.task.rewards:
            total += term.weight * term(self)
        return (total.clamp_min(0.0) if self.task.clip_reward else total) * CONTROL_DT

    def _push(self) -> None:
        strength = self.task.randomisation.push
        if strength == 0.0:
            return
        worlds = select(self.steps >= self._push_at)
        if not len(worlds):
            return
        velocity = uniform(((-strength, strength),) * 6, len(worlds), self.generator)
        velocity[:, 2] = 0.0
        self.physics.push(worlds, velocity)
        self._read()
        later = self._later(self.task.randomisation.push_interval_s, len(worlds))
        put(self._push_at, worlds, pick(self.steps, worlds) + later)

    def _resample(self) -> None:
        if self.task.command is None or self.task.resample_s is None:
            return
        worlds = select(self.steps >= self._resample_at)
        if len(worlds):
            put(self.command, worlds, self._commands(len(worlds)))
            later = self._later(self.task.resample_s, len(worlds))
            put(self._resample_at, worlds, pick(self.steps, worlds) + later)

    def _commands(self, count: int) -> torch.Tensor:
        # Targets are relative to the middle of the reset spread, the worlds' origin.
        assert self.task.command is not None
        return self.task.command.sample(torch.zeros(count, 3, device=self.device), self.generator)

    def _later(self, seconds: tuple[float, float] | None, count: int) -> torch.Tensor:
        if seconds is None:
            return torch.full((count,), self.task.episode_steps + 1, device=self.device)
        return (uniform((seconds,), count, self.generator)[:, 0] / CONTROL_DT).long()

    def _uniform(self, *shape: int) -> torch.Tensor:
        return torch.rand(shape, generator=self.generator, device=self.device)
