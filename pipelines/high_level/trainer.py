"""The high level's training: PPO over latents on the reach task, begun with hindsight."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import torch
from tensordict import TensorDict

from lacoloco.pipelines.high_level.config import TrainHighConfig
from lacoloco.pipelines.high_level.hindsight import clone_hindsight, explore
from lacoloco.pipelines.learn import parallel
from lacoloco.pipelines.learn.cat import ramp
from lacoloco.pipelines.learn.latents import latent_usage, project
from lacoloco.pipelines.learn.metric_accumulator import MetricAccumulator
from lacoloco.pipelines.learn.networks import geometric, set_std
from lacoloco.pipelines.learn.ppo import Ppo
from lacoloco.pipelines.masking import perhaps_any
from lacoloco.pipelines.policies import Head, Policy
from lacoloco.pipelines.sim.commands import TargetCommand
from lacoloco.pipelines.sim.env import LeggedEnv
from lacoloco.pipelines.sim.episode_restarts import EpisodeRestarts
from lacoloco.pipelines.sim.hierarchical_env import HOLD_STEPS, LatentSteeredEnv
from lacoloco.pipelines.sim.randomisation import widened
from lacoloco.pipelines.sim.state import layout, width
from lacoloco.pipelines.sim.tasks import load_task
from lacoloco.robots.spec import RobotSpec

POLICY = "policy"


class HighTrainer:
    """PPO over latents on the reach task; see :class:`lacoloco.pipelines.training.loop.Trainer`."""

    def __init__(
        self, spec: RobotSpec, low: Policy, config: TrainHighConfig, *, seed: int, device: str
    ) -> None:
        """Build the hierarchy and the learner."""
        torch.manual_seed(seed)
        self.config = config
        self.not_reached = spec.skills.not_reached
        task = load_task(spec, "reach")
        task = replace(
            task,
            command=replace(task.command, near=config.near_target_fraction)
            if task.has_target
            else task.command,
            randomisation=widened(task.randomisation, config.randomisation),
            fall_tilt=spec.terminations.training_tilt,
        )
        env = LeggedEnv(spec, task, config.worlds, seed=seed, device=device)
        # Evenly among the worlds: PPO orders them by how often they act on the mean.
        place = torch.arange(config.worlds, device=device)
        env.noise[
            ((place + 1) * config.noise_free_fraction).long()
            > (place * config.noise_free_fraction).long()
        ] = 0.0
        self.latent_dim = low.head.sizes["latent"]
        self.env = LatentSteeredEnv(env, low, self.latent_dim)
        # Whole decisions only, so that time-outs stay on the boundary between two latents.
        decisions = (env.task.episode_steps // HOLD_STEPS, (config.worlds,))
        env.steps = HOLD_STEPS * torch.randint(0, *decisions, generator=env.draw, device=env.device)
        sizes = {POLICY: width(self.env.terms)}
        self.algorithm = Ppo(
            sizes, self.latent_dim, config.worlds, config.ppo, config.networks, device
        )
        self.head = Head(
            "high", sizes, self.latent_dim, config.networks, layout(self.env.terms), "reach"
        )
        self.samples_per_iteration = config.worlds * config.ppo.horizon * HOLD_STEPS
        self.generator = torch.Generator(device).manual_seed(seed + 1)
        self.restarts = EpisodeRestarts(
            env, self.latent_dim, config.restart_probability, seed=seed + 2, hold=HOLD_STEPS
        )
        self.algorithm.warm_up(self._random_observations())

    def pretrain(self) -> float:
        """Begin with a policy that chooses latents by where they led before; returns the cosine to
        those.

        Every process has its own worlds, but the first one's policy counts.
        """
        task, config = self.env.env.task, self.config.hindsight
        distances = self.env.env.spec.hindsight
        if not isinstance(task.command, TargetCommand):
            return 0.0
        command = task.command
        memory = explore(self.env, config, self.generator)
        columns = {row["name"]: slice(*row["slice"]) for row in self.head.layout}
        agreement = clone_hindsight(
            self.algorithm.actor, memory, command, columns, distances, config, self.generator
        )
        parallel.copy_from_first(self.algorithm.actor)
        return agreement

    @property
    def iterations(self) -> int:
        """Iterations that the budget of decisions allows."""
        return max(1, round(self.config.decisions / (self.config.worlds * self.config.ppo.horizon)))

    def iterate(self, progress: float) -> dict[str, float]:
        """One rollout and its update."""
        env, algorithm, config = self.env, self.algorithm, self.config
        algorithm.actor_learns = not config.hindsight.decisions or progress >= config.critic_warmup
        calm, begin, end = config.kl_anneal
        algorithm.desired_kl = config.ppo.desired_kl * geometric(
            (1.0, calm), ramp(progress, begin, end)
        )
        price = (config.contact_force_penalty or 0.0) * ramp(
            progress, *config.contact_force_penalty_ramp
        )
        rematch = progress >= config.replay_failed_from
        std = geometric(config.std, progress)
        set_std(algorithm.actor, std)
        algorithm.exploration.high_noise_scale = config.std[0] / std
        obs = self._observe()
        accumulator, fresh = (
            MetricAccumulator(),
            torch.zeros(env.num_worlds, dtype=torch.bool, device=env.env.device),
        )
        for _ in range(config.ppo.horizon):
            self.restarts.snapshot(env.latent)
            decision = env.step(project(algorithm.act(obs)))
            next_obs = self._observe()
            reward = decision.reward * config.reward_scale - config.fall_penalty * decision.fell
            reward -= price * decision.violation
            algorithm.record(reward, decision.fell, decision.timed_out, next_obs)
            # Only whole episodes are counted: a fall or a miss, but not what comes of its restarts.
            whole = decision.done & ~self.restarts.returned
            missed = decision.timed_out & (decision.error > self.not_reached)
            again = self.restarts.select(decision.fell, missed if rematch else None)
            env.reset(decision.done)
            fresh |= decision.done & ~again
            env.latent = self.restarts.restore(again, env.latent)
            obs = self._observe() if perhaps_any(decision.done) else next_obs
            errors = torch.where(whole, decision.error, 0.0).sum()
            speed = env.env.state.lin_vel_b[:, :2].norm(dim=-1).mean()
            accumulator.add(
                reward=decision.reward.mean(),
                falls=(decision.fell & whole).sum(),
                ended=whole.sum(),
                errors=errors,
                speed=speed,
                above=decision.above_limit.mean(dim=1).sum(),
                substeps=decision.substeps.sum(),
            )
        env.env.redraw(fresh)
        algorithm.compute_returns(obs)
        usage = latent_usage(project(algorithm.storage.distribution_params[0].flatten(0, 1)))
        figures = algorithm.update() | usage
        sums = accumulator.read()
        if ended := sums["ended"]:
            figures |= {
                "final_error": sums["errors"] / ended,
                "falls_per_episode": sums["falls"] / ended,
            }
        means = {name: sums[name] / config.ppo.horizon for name in ("reward", "speed")}
        violation = sums["above"] / max(sums["substeps"], 1.0)
        return figures | means | {"contact_violation": violation, "std": std, "episodes": ended}

    def policy(self) -> Policy:
        """The trained actor, deterministic; its output is projected to the sphere by whoever uses
        it.
        """
        return Policy(self.head, self.algorithm.actor.eval())

    def state_dict(self) -> dict[str, Any]:
        """See :class:`lacoloco.pipelines.training.loop.Trainer`."""
        return {
            "algorithm": self.algorithm.save(),
            "env": self.env.env.state_dict(),
            "latent": self.env.latent,
            "restarts": self.restarts.state_dict(),
        }

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """See :class:`lacoloco.pipelines.training.loop.Trainer`."""
        self.algorithm.load(state["algorithm"], None, True)
        self.env.env.load_state_dict(state["env"])
        self.env.latent = state["latent"].to(self.env.device)
        self.restarts.load_state_dict(state["restarts"])

    def _observe(self) -> TensorDict:
        return TensorDict({POLICY: self.env.observe()}, batch_size=[self.env.num_worlds])

    def _random_observations(self) -> TensorDict:
        seen = []
        for _ in range(8):
            z = project(torch.randn(self.env.num_worlds, self.latent_dim, device=self.env.device))
            decision = self.env.step(z)
            self.env.reset(decision.done)
            seen.append(self._observe())
        return torch.cat(seen)
