"""The high level's world: one latent in, five low-level control steps, one decision's outcome out
(10 Hz).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import torch

from lacoloco.pipelines.sim import state as layouts
from lacoloco.pipelines.sim.env import LeggedEnv
from lacoloco.pipelines.sim.observation import FULL, Observation
from lacoloco.pipelines.sim.state import Term
from lacoloco.pipelines.sim.views import View, recorded_terms

HOLD_STEPS = 5
"""Control steps for which one latent is held (paper: 10 Hz over 50 Hz)."""
SAMPLED_SHARE = 0.75
"""Part of a control step over which the original's force sensor reports the maximum: the last 15
of 20 ms.
"""


@dataclass(frozen=True)
class Decision:
    """What came of one latent in N worlds, before any reset.

    Attributes:
        reward: (N,) mean task reward of the control steps lived through, 0 for those after a fall
            (the original's code adds them).
        fell: (N,) bool.
        timed_out: (N,) bool.
        error: (N,) distance of the end effector from the target at the last step lived through [m].
        above_limit: (N, F) foot-substeps with a contact force above the limit.
        substeps: (N,) foot-substeps counted per foot.
        sampled: (N,) bool, worlds that lived to the decision's last control step. The original
            looks at the forces there only, at 10 Hz.
        sampled_above: (N, F) bool, of these, feet whose largest force in the last 15 ms of that
            step was above the limit. Six substeps of 3.3 ms: the last five.
        diverged: (N,) bool, of those that fell, the worlds whose physics diverged.
    """

    reward: torch.Tensor
    fell: torch.Tensor
    timed_out: torch.Tensor
    error: torch.Tensor
    above_limit: torch.Tensor
    substeps: torch.Tensor
    sampled: torch.Tensor
    sampled_above: torch.Tensor
    diverged: torch.Tensor

    @property
    def done(self) -> torch.Tensor:
        """(N,) bool, worlds to reset."""
        return self.fell | self.timed_out

    @property
    def violation(self) -> torch.Tensor:
        """(N,) share of the foot-substeps lived through with a contact force above the limit."""
        return self.above_limit.mean(dim=1) / self.substeps.clamp(min=1.0)


class LatentSteeredEnv:
    """A reach environment driven through a frozen low level; ``low(obs (N, P), z (N, d)) -> actions
    (N, J)``.
    """

    def __init__(
        self,
        env: LeggedEnv,
        low: Callable[[torch.Tensor, torch.Tensor], torch.Tensor],
        latent_dim: int,
        low_sees: Observation = FULL,
        high_sees: Observation = FULL,
    ) -> None:
        """Wrap an environment; without a target, errors stay 0. Each level observes as it was
        trained to.
        """
        self.env, self.low = env, low
        self.num_worlds, self.device = env.num_worlds, env.device
        self.latent = torch.zeros(env.num_worlds, latent_dim, device=env.device)
        self.terms: tuple[Term, ...] = layouts.high_level_terms(
            env.spec.num_joints,
            latent_dim,
            env.spec.observation_noise,
            None if env.task.command is None else env.task.command.term,
        )
        self.limit = env.spec.foot_force_limit()
        self._frame = 10 + 2 * env.spec.num_joints
        self._low_width = self._frame + env.num_actions
        self._low_view: View | None = None
        self._high_view: View | None = None
        if low_sees != FULL:
            self._low_view = View(env, recorded_terms(env), low_sees)
        if high_sees != FULL:
            self._high_view = View(env, self.terms, high_sees)
            self.terms = self._high_view.terms

    def observe(self) -> torch.Tensor:
        """(N, width of ``terms``): noisy style frame, command (a target in the base frame), last
        latent, or what the high level's observation makes of them.
        """
        if self._high_view is not None:
            return self._high_view(self.latent)
        full = self.env.observe()
        return torch.cat((full[:, : self._frame], full[:, self._low_width :], self.latent), dim=-1)

    def observe_low(self) -> torch.Tensor:
        """(N, P) what the low level sees."""
        if self._low_view is not None:
            return self._low_view()
        return self.env.observe()[:, : self._low_width]

    def step(self, z: torch.Tensor, on_step: Callable[[LeggedEnv], None] | None = None) -> Decision:
        """Hold unit latents (N, d) for five control steps; ``on_step`` sees the environment after
        each of them.
        """
        env, n = self.env, self.num_worlds
        alive = torch.ones(n, dtype=torch.bool, device=self.device)
        fell, timed_out, diverged = (torch.zeros_like(alive) for _ in range(3))
        reward, error = torch.zeros(n, device=self.device), torch.zeros(n, device=self.device)
        above = torch.zeros(n, len(env.spec.feet), device=self.device)
        lived = torch.zeros(n, device=self.device)
        self.latent = z
        sampled = alive
        for _ in range(HOLD_STEPS):
            sampled = alive
            step = env.step(self.low(self.observe_low(), z))
            reward += step.reward * alive / HOLD_STEPS
            if env.task.has_target:
                error = torch.where(alive, env.target_error(), error)
            above += (env.physics.foot_force > self.limit).float().sum(dim=1) * alive[:, None]
            lived += alive.float() * env.physics.foot_force.shape[1]
            if on_step is not None:
                on_step(env)
            fell |= step.fell & alive
            diverged |= ~step.valid & alive
            timed_out |= step.timed_out & alive
            alive &= ~step.done
        forces = env.physics.foot_force
        window = math.ceil(SAMPLED_SHARE * forces.shape[1])
        sampled_above = (forces[:, -window:] > self.limit).any(dim=1) & sampled[:, None]
        return Decision(
            reward, fell, timed_out, error, above, lived, sampled, sampled_above, diverged
        )

    def reset(self, mask: torch.Tensor) -> torch.Tensor:
        """Start new episodes in the worlds of ``mask``; their last latent becomes zero.

        Returns:
            (N, d) last latents.
        """
        self.env.reset(mask)
        self.latent = torch.where(mask[:, None], 0.0, self.latent)
        return self.latent
