"""The experts that perform the synthetic motions: one policy per skill, PPO under constraints
(paper, "Motion Datasets").
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any

import torch
from tensordict import TensorDict

from lacoloco.pipelines.learn.cat import SoftTerminations, ramp
from lacoloco.pipelines.learn.metric_accumulator import MetricAccumulator
from lacoloco.pipelines.learn.networks import NetworkConfig, geometric, set_std
from lacoloco.pipelines.learn.ppo import Ppo, PpoConfig
from lacoloco.pipelines.masking import perhaps_any
from lacoloco.pipelines.policies import Head, Policy
from lacoloco.pipelines.sim.env import LeggedEnv
from lacoloco.pipelines.sim.state import layout, width
from lacoloco.pipelines.sim.tasks import Task, load_task
from lacoloco.robots.spec import RobotSpec

POLICY = "policy"


@dataclass(frozen=True)
class ExpertConfig:
    """Training of one expert.

    Attributes:
        worlds: parallel worlds.
        samples: control steps in all.
        reward_scale: factor on the task's reward, so that returns are near 1.
        ramp: shares of the training between which the constraints rise from nothing to full
            strength.
        std: exploration std at the start and at the end, in raw action units. On a schedule: a
            learned one collapses within a million samples, long before the foot has found its
            target.
    """

    worlds: int = 512
    samples: int = 2_500_000
    reward_scale: float = 3.0
    ramp: tuple[float, float] = (0.05, 0.6)
    std: tuple[float, float] = (0.5, 0.15)
    ppo: PpoConfig = field(
        default_factory=lambda: PpoConfig(
            horizon=24,
            learning_rate=2e-4,
            min_learning_rate=5e-5,
            max_learning_rate=3e-3,
            desired_kl=0.02,
        )
    )
    networks: NetworkConfig = field(default_factory=NetworkConfig)


def reach_expert() -> ExpertConfig:
    """Less noise for the larger action scale of reaching."""
    return ExpertConfig(std=(0.25, 0.1))


def wide(expert: ExpertConfig, iterations: int) -> ExpertConfig:
    """An expert's recipe on a GPU's width, for so many iterations of 4096 worlds."""
    ppo = replace(expert.ppo, minibatches=6)
    return replace(expert, worlds=4096, samples=iterations * ppo.horizon * 4096, ppo=ppo)


def smoke_expert() -> ExpertConfig:
    """Two iterations of a tiny network."""
    return ExpertConfig(
        worlds=16,
        samples=16 * 4 * 2,
        ppo=PpoConfig(horizon=4, epochs=1, minibatches=2),
        networks=NetworkConfig(actor=(32,), critic=(32,)),
    )


def clean(task: Task) -> Task:
    """The task as experts train on it and are recorded: own friction and masses per world, but no
    noise and no pushes.
    """
    return replace(task, noise=0.0, randomisation=replace(task.randomisation, push=0.0))


class ExpertTrainer:
    """PPO + CaT on one task; see :class:`lacoloco.pipelines.training.trainer.Trainer`."""

    def __init__(
        self, spec: RobotSpec, task_name: str, config: ExpertConfig, *, seed: int, device: str
    ) -> None:
        """Build the environment and the learner."""
        torch.manual_seed(seed)
        # Nobody deploys an expert, so it may see clearly; but its clips must show every world the
        # low level will meet.
        self.config, self.task = config, clean(load_task(spec, task_name))
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
        return max(1, round(self.config.samples / self.samples_per_iteration))

    def iterate(self, progress: float) -> dict[str, float]:
        """One rollout and its update."""
        env, algorithm = self.env, self.algorithm
        strength = ramp(progress, *self.config.ramp)
        std = geometric(self.config.std, progress)
        set_std(algorithm.actor, std)
        tally = MetricAccumulator()
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
            tally.add(
                falls=step.fell.sum(),
                reward=step.reward.mean(),
                delta=None if delta is None else delta.mean(),
            )
        algorithm.compute_returns(obs)
        figures = algorithm.update()
        steps, sums = self.config.ppo.horizon, tally.read()
        return (
            figures
            | self._task_figures()
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
        seen = []
        for _ in range(self.config.ppo.horizon):
            step = self.env.step(
                0.3 * torch.randn(self.env.num_worlds, self.env.num_actions, device=self.env.device)
            )
            self.env.reset(step.done)
            seen.append(self._observe())
        return torch.cat(seen)

    def _task_figures(self) -> dict[str, float]:
        if self.task.name == "walk":
            error = self.env.state.lin_vel_b[:, :2] - self.env.command[:, :2]
            return {"velocity_error": float(torch.linalg.vector_norm(error, dim=-1).mean())}
        return {"target_error": float(self.env.target_error().mean())}
