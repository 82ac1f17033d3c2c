"""The environment of the tracker: every world follows a clip, step by step.

A retargeted clip is kinematics. Its feet stand exactly on a floor into which simulated feet sink,
and nobody has checked the forces on its trunk against the motors. A discriminator tells such a clip
from a simulated robot by this alone, and actions inferred from it hold for a tenth of a second.
Followed by a policy that sees the next frames, the same motion obeys the physics of the robot that
is to learn it. The method is DeepMimic's, but in the base frame: place and heading do not count.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import torch
from tensordict import TensorDict

from lacoloco.datasets.motion_library import MotionLibrary
from lacoloco.pipelines.masking import pick, select
from lacoloco.pipelines.sim.env import LeggedEnv, Step
from lacoloco.pipelines.sim.physics import CONTROL_DT
from lacoloco.pipelines.sim.tasks import Task, imitate_task
from lacoloco.pipelines.tracking.config import TrackerConfig
from lacoloco.pipelines.tracking.reference_motion import ReferenceMotion
from lacoloco.robots.spec import RobotSpec

POLICY, REFERENCE = "policy", "reference"
"""Observation groups: the robot's own view, and the next frames of the clip."""
NEVER = -1
"""Value of `stop_at` in a world that does not stop; no episode has this age."""


class TrackingEnv:
    """N worlds, each on its way through a clip.

    Attributes:
        rows: (N,) row of the reference motion that the robot should be in.
        grace_until: (N,) age of the episode, in control steps, until which a large error does not
            terminate it.
        stop_at: (N,) age of the episode, in control steps, at which the reference changes to
            standing still; ``NEVER`` in most worlds.
    """

    def __init__(
        self,
        spec: RobotSpec,
        library: MotionLibrary,
        reference: ReferenceMotion,
        config: TrackerConfig,
        worlds: int,
        *,
        seed: int,
        device: str,
    ) -> None:
        """Build the worlds; ``reference`` is the reference motion of ``library``."""
        self.config, self.motions, self.reference = config, library, reference
        self.base = LeggedEnv(spec, _task(spec, config), worlds, seed=seed, device=device)
        self.generator = torch.Generator(device).manual_seed(seed + 1)
        self.rows = torch.zeros(worlds, dtype=torch.long, device=device)
        self.grace_until = torch.zeros_like(self.rows)
        self.stop_at = torch.full_like(self.rows, NEVER)
        slow = reference.speed < spec.tracking.slow_speed
        self._slow_rows = torch.nonzero(slow if bool(slow.any()) else ~slow).flatten()

    @property
    def num_worlds(self) -> int:
        """Number of worlds N."""
        return self.base.num_worlds

    def observe(self) -> TensorDict:
        """Both observation groups of every world."""
        groups = {POLICY: self.base.observe(), REFERENCE: self.reference.lookahead(self.rows)}
        return TensorDict(groups, batch_size=[self.num_worlds])

    def step(self, residual: torch.Tensor) -> tuple[Step, torch.Tensor, torch.Tensor, torch.Tensor]:
        """Add ``residual`` (N, J) to the inferred actions and advance by one control step.

        Returns:
            The step; (N,) reward in [0, 1]; (N,) bool terminated early, by a fall or by a large
            error; (N,) bool truncated, by the end of the clip or of the episode.
        """
        step = self.base.step(self.reference.actions[self.rows] + residual)
        last = self.reference.states.last
        self.rows = torch.minimum(self.rows + 1, last[self.rows])
        reward, deviated = self.reference.compare(self.base.state, self.rows)
        terminated = step.fell | deviated & (self.base.steps > self.grace_until)
        truncated = (step.timed_out | (self.rows == last[self.rows])) & ~terminated
        self._stop(self.base.steps == self.stop_at)
        return step, reward.masked_fill(~step.valid, 0.0), terminated, truncated

    def reset(self, mask: torch.Tensor) -> None:
        """Start new episodes in the worlds of ``mask`` (N,) bool.

        An episode starts at any moment of a clip, in the clip's state, or in the default pose at a
        slow moment.
        """
        count, device = self.num_worlds, self.generator.device
        sampled = self.motions.sample(count, generator=self.generator, margin=2.0 * CONTROL_DT)
        anywhere = self.reference.states.rows(*sampled)
        chosen = torch.randint(
            len(self._slow_rows), (count,), generator=self.generator, device=device
        )
        kind, when = torch.rand(2, count, generator=self.generator, device=device)
        standing = kind < self.config.standing_start_fraction
        self.reset_to(mask, torch.where(standing, self._slow_rows[chosen], anywhere), standing)
        stop_share = self.config.stop_fraction * (1.0 - self.config.standing_start_fraction)
        stops = mask & (kind > 1.0 - stop_share)
        earliest, latest = (seconds / CONTROL_DT for seconds in self.config.stop_after_s)
        stop_at = (earliest + when * (latest - earliest)).long()
        self.stop_at = torch.where(stops, stop_at, self.stop_at)

    def reset_to(self, mask: torch.Tensor, rows: torch.Tensor, standing: torch.Tensor) -> None:
        """Start new episodes in the worlds of ``mask`` (N,) bool at the moments ``rows`` (N,).

        Worlds of ``standing`` (N,) bool start in the default pose, the others in the clip's state.
        None of them will stop.
        """
        self.rows = torch.where(mask, rows, self.rows)
        grace = torch.where(standing, round(self.config.grace_s / CONTROL_DT), 0)
        self.grace_until = torch.where(mask, grace, self.grace_until)
        self.stop_at = torch.where(mask, NEVER, self.stop_at)
        self.base.reset(mask)
        in_clip = select(mask & ~standing)
        if len(in_clip):
            chosen, states = pick(self.rows, in_clip), self.reference.states
            previous = self.reference.previous_actions[chosen]
            self.base.start_from(in_clip, states.qpos[chosen], states.qvel[chosen], previous)

    def state_dict(self) -> dict[str, Any]:
        """Everything that decides how the worlds go on."""
        return {
            "base": self.base.state_dict(),
            "generator": self.generator.get_state(),
            "rows": self.rows,
            "grace_until": self.grace_until,
            "stop_at": self.stop_at,
        }

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Inverse of :meth:`state_dict`."""
        self.base.load_state_dict(state["base"])
        self.generator.set_state(state["generator"])
        for name in ("rows", "grace_until", "stop_at"):
            setattr(self, name, state[name].to(self.base.device))

    def _stop(self, mask: torch.Tensor) -> None:
        """Change the reference to standing still in the worlds of ``mask`` (N,) bool."""
        grace_until = self.base.steps + round(self.config.grace_s / CONTROL_DT)
        self.rows = torch.where(mask, self.reference.standing_row, self.rows)
        self.grace_until = torch.where(mask, grace_until, self.grace_until)


def _task(spec: RobotSpec, config: TrackerConfig) -> Task:
    """The imitation task with its randomised robots and floors, but without noise and pushes.

    The clips must show every robot and floor that the low level will meet. Pushes and noise would
    add motion that the clips do not mean.
    """
    task = imitate_task(spec, constrained=True)
    return replace(
        task,
        memory=0,
        noise=0.0,
        episode_s=config.episode_s,
        reset=replace(task.reset, clip_share=0.0, lin_vel=0.0, ang_vel=0.0),
        randomisation=replace(task.randomisation, push=0.0),
    )
