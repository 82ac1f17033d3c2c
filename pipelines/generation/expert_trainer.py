"""The experts that perform the synthetic motions: one policy per skill, PPO under constraints
(paper, "Motion Datasets").
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any, cast

import torch
from tensordict import TensorDict

from lacoloco.pipelines.generation.config import ExpertConfig
from lacoloco.pipelines.generation.transfer import transferred
from lacoloco.pipelines.learn.cat import SoftTerminations, ramp
from lacoloco.pipelines.learn.metric_accumulator import MetricAccumulator
from lacoloco.pipelines.learn.networks import geometric, set_std
from lacoloco.pipelines.learn.ppo import Ppo
from lacoloco.pipelines.masking import perhaps_any
from lacoloco.pipelines.policies import Head, Policy
from lacoloco.pipelines.sim.env import LeggedEnv
from lacoloco.pipelines.sim.state import layout, width
from lacoloco.pipelines.sim.tasks import Task, load_task
from lacoloco.robots.spec import RobotSpec

POLICY = "policy"


def without_noise(task: Task) -> Task:
    """The task as experts train on it: own friction and masses per world, the task's pushes, but no
    noise. An expert is never deployed.
    """
    return replace(task, noise=0.0)


def without_disturbances(task: Task) -> Task:
    """The task as experts are recorded: without pushes, too."""
    return replace(without_noise(task), randomisation=replace(task.randomisation, push=0.0))


class ExpertTrainer:
    """PPO + CaT on one task; see :class:`lacoloco.pipelines.training.trainer.Trainer`."""

    def __init__(
        self, spec: RobotSpec, task_name: str, config: ExpertConfig, *, seed: int, device: str
    ) -> None:
        """Build the environment and the learner."""
        torch.manual_seed(seed)
        # Its clips must show every robot and floor that the low level will meet.
        self.config, self.task = config, without_noise(load_task(spec, task_name))
        self.env = LeggedEnv(spec, self.task, config.worlds, seed=seed, device=device)
        self.env.stagger()
        sizes = {POLICY: width(self.env.terms)}
        self.algorithm = Ppo(
            sizes, self.env.num_actions, config.worlds, config.ppo, config.networks, device
        )
        self.algorithm.warm_up(self._random_observations())
        self.terminations = SoftTerminations({c.name: c.max_p for c in self.task.constraints})
        self.head = Head(
            task_name,
            sizes,
            self.env.num_actions,
            config.networks,
            layout(self.env.terms),
            task_name,
        )
        self.samples_per_iteration = config.worlds * config.ppo.horizon

    @property
    def iterations(self) -> int:
        """Iterations that the budget of samples allows."""
        samples = self.config.samples * self.task.sample_factor
        return max(1, round(samples / self.samples_per_iteration))

    def iterate(self, progress: float) -> dict[str, float]:
        """One rollout and its update."""
        env, algorithm = self.env, self.algorithm
        strength = ramp(progress, *self.config.ramp)
        std = geometric(self.config.std, progress)
        set_std(algorithm.actor, std)
        totals = MetricAccumulator()
        obs = self._observe()
        for _ in range(self.config.ppo.horizon):
            step = env.step(algorithm.act(obs))
            delta = self.terminations(step.violations, strength) if step.violations else None
            next_obs = self._observe()
            algorithm.record(
                step.reward * self.config.reward_scale, step.fell, step.timed_out, next_obs, delta
            )
            env.reset(step.done)
            obs = self._observe() if perhaps_any(step.done) else next_obs
            totals.add(
                falls=step.fell.sum(),
                reward=step.reward.mean(),
                delta=None if delta is None else delta.mean(),
            )
        algorithm.compute_returns(obs)
        metrics = algorithm.update()
        steps, sums = self.config.ppo.horizon, totals.read()
        return (
            metrics
            | self._task_metrics()
            | {
                "reward": sums["reward"] / steps,
                "falls_per_1000_steps": 1000.0 * sums["falls"] / self.samples_per_iteration,
                "delta": sums.get("delta", 0.0) / steps,
                **{
                    f"violation_{name}": float(share)
                    for name, share in self.terminations.violated.items()
                },
                "std": std,
            }
        )

    def policy(self) -> Policy:
        """The trained actor, deterministic."""
        return Policy(replace(self.head), self.algorithm.actor.eval())

    def start_from(self, other: ExpertTrainer) -> None:
        """Begin as another task's expert that is told nothing: its networks, with zero weights for
        this task's command.

        Raises:
            StageError: The two see other things besides their commands.
        """
        for mine, theirs in (
            (self.algorithm.actor, other.algorithm.actor),
            (self.algorithm.critic, other.algorithm.critic),
        ):
            mine.load_state_dict(
                transferred(mine.state_dict(), theirs.state_dict(), self.env.terms, other.env.terms)
            )

    def state_dict(self) -> dict[str, Any]:
        """See :class:`lacoloco.pipelines.training.trainer.Trainer`."""
        return {
            "algorithm": self.algorithm.save(),
            "env": self.env.state_dict(),
            "terminations": self.terminations.state_dict(),
        }

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """See :class:`lacoloco.pipelines.training.trainer.Trainer`."""
        self.algorithm.load(state["algorithm"], None, True)
        self.env.load_state_dict(state["env"])
        self.terminations.load_state_dict(state["terminations"])

    def _observe(self) -> TensorDict:
        return TensorDict({POLICY: self.env.observe()}, batch_size=[self.env.num_worlds])

    def _random_observations(self) -> TensorDict:
        seen: list[Any] = []
        for _ in range(self.config.ppo.horizon):
            step = self.env.step(
                0.3 * torch.randn(self.env.num_worlds, self.env.num_actions, device=self.env.device)
            )
            self.env.reset(step.done)
            seen.append(self._observe())
        return cast("TensorDict", torch.cat(seen))

    def _task_metrics(self) -> dict[str, float]:
        if self.task.name == "walk":
            state, command = self.env.state, self.env.command
            error = torch.linalg.vector_norm(state.lin_vel_b[:, :2] - command[:, :2], dim=-1)
            turning = (state.ang_vel_b[:, 2] - command[:, 2]).abs()
            return {"velocity_error": float(error.mean()), "yaw_error": float(turning.mean())}
        return {"target_error": float(self.env.target_error().mean())}
