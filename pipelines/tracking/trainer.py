"""Training of the tracker: a policy that follows clips in simulation."""

from __future__ import annotations

from typing import Any, cast

import torch
from tensordict import TensorDict

from lacoloco.datasets.motion_library import MotionLibrary
from lacoloco.pipelines.learn.cat import SoftTerminations, ramp
from lacoloco.pipelines.learn.metric_accumulator import MetricAccumulator
from lacoloco.pipelines.learn.networks import geometric, set_std
from lacoloco.pipelines.learn.ppo import Ppo
from lacoloco.pipelines.masking import perhaps_any
from lacoloco.pipelines.policies import Head, Policy
from lacoloco.pipelines.sim.state import layout, width
from lacoloco.pipelines.tracking.config import TrackerConfig
from lacoloco.pipelines.tracking.env import POLICY, REFERENCE, TrackingEnv
from lacoloco.pipelines.tracking.reference_motion import ReferenceMotion
from lacoloco.robots.spec import RobotSpec


class TrackerTrainer:
    """PPO on following the clips; see :class:`lacoloco.pipelines.training.trainer.Trainer`."""

    def __init__(
        self,
        spec: RobotSpec,
        library: MotionLibrary,
        config: TrackerConfig,
        *,
        seed: int,
        device: str,
    ) -> None:
        """Build worlds and learner."""
        torch.manual_seed(seed)
        self.config = config
        reference = ReferenceMotion(spec, library)
        self.env = TrackingEnv(
            spec, library, reference, config, config.worlds, seed=seed, device=device
        )
        base = self.env.base
        sizes = {POLICY: width(base.terms), REFERENCE: reference.width}
        self.algorithm = Ppo(
            sizes, base.num_actions, config.worlds, config.ppo, config.networks, device
        )
        self.terminations = SoftTerminations({c.name: c.max_p for c in base.task.constraints})
        self.head = Head(
            "track", sizes, base.num_actions, config.networks, layout(base.terms), "imitate"
        )
        self.samples_per_iteration = config.worlds * config.ppo.horizon
        all_worlds = torch.ones(config.worlds, dtype=torch.bool, device=device)
        self.env.reset(all_worlds)
        self.algorithm.warm_up(self._first_observations(all_worlds))

    @property
    def iterations(self) -> int:
        """Iterations that the budget of samples allows."""
        return max(1, round(self.config.samples / self.samples_per_iteration))

    def iterate(self, progress: float) -> dict[str, float]:
        """One rollout and its update."""
        config = self.config
        std = geometric(config.std, progress)
        set_std(self.algorithm.actor, std)
        sums = self._roll_out(ramp(progress, *config.ramp))
        metrics = self.algorithm.update()
        per_thousand = 1000.0 / self.samples_per_iteration
        violations = {
            f"violation_{name}": float(share) for name, share in self.terminations.violated.items()
        }
        return metrics | {
            "reward": sums["reward"] / config.ppo.horizon,
            "early_terminations_per_1000_steps": per_thousand * sums["early_terminations"],
            "falls_per_1000_steps": per_thousand * sums["falls"],
            **violations,
            "std": std,
        }

    def policy(self) -> Policy:
        """The trained actor, deterministic."""
        return Policy(self.head, self.algorithm.actor.eval())

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

    def _roll_out(self, strength: float) -> dict[str, float]:
        """Fill the rollout buffer; constraints act with ``strength`` in [0, 1].

        Returns:
            Sums over the rollout of the mean reward, of early terminations and of falls.
        """
        env, algorithm, totals = self.env, self.algorithm, MetricAccumulator()
        reward_scale = 1.0 - self.config.ppo.gamma
        obs = env.observe()
        for _ in range(self.config.ppo.horizon):
            step, reward, terminated, truncated = env.step(algorithm.act(obs))
            delta = self.terminations(step.violations, strength) if step.violations else None
            next_obs, done = env.observe(), terminated | truncated
            algorithm.record(reward_scale * reward, terminated, truncated, next_obs, delta)
            if perhaps_any(done):
                env.reset(done)
                next_obs = env.observe()
            obs = next_obs
            totals.add(
                reward=reward.mean(), early_terminations=terminated.sum(), falls=step.fell.sum()
            )
        algorithm.compute_returns(obs)
        return totals.read()

    def _first_observations(self, all_worlds: torch.Tensor) -> TensorDict:
        """Observations under random residuals, from which the normaliser starts."""
        seen: list[Any] = []
        for _ in range(8):
            self.env.reset(all_worlds)
            for _ in range(4):
                noise = torch.randn(len(all_worlds), self.env.base.num_actions)
                self.env.step((self.config.std[0] * noise).to(all_worlds.device))
                seen.append(self.env.observe())
        self.env.reset(all_worlds)
        return cast("TensorDict", torch.cat(seen))
