"""The high level's training: PPO over latents, begun with a policy made from what latents do."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, cast

import torch
from tensordict import TensorDict

from lacoloco.pipelines.evaluation.hardware_shift import IN_TRAINING
from lacoloco.pipelines.high_level.config import TrainHighConfig
from lacoloco.pipelines.high_level.skill_dynamics import SkillDynamics, fit_dynamics, fit_policy
from lacoloco.pipelines.high_level.trials import Trials, try_latents
from lacoloco.pipelines.learn import parallel
from lacoloco.pipelines.learn.cat import ramp
from lacoloco.pipelines.learn.latents import latent_usage, project
from lacoloco.pipelines.learn.metric_accumulator import MetricAccumulator
from lacoloco.pipelines.learn.networks import annealed, geometric, mean_std, set_std
from lacoloco.pipelines.learn.ppo import Ppo
from lacoloco.pipelines.masking import perhaps_any
from lacoloco.pipelines.policies import Head, Policy
from lacoloco.pipelines.sim.commands import TargetCommand
from lacoloco.pipelines.sim.env import LeggedEnv
from lacoloco.pipelines.sim.episode_restarts import EpisodeRestarts
from lacoloco.pipelines.sim.hierarchical_env import HOLD_STEPS, Decision, LatentSteeredEnv
from lacoloco.pipelines.sim.randomisation import widened
from lacoloco.pipelines.sim.state import layout, width
from lacoloco.pipelines.sim.tasks import Task, load_task
from lacoloco.pipelines.training.critic import critic_only, for_critic
from lacoloco.pipelines.training.pretraining import PretrainingLog
from lacoloco.robots.spec import RobotSpec

POLICY = "policy"
SHAPING = "progress"
"""The reward that shapes; see :mod:`lacoloco.pipelines.sim.rewards`."""


@dataclass(frozen=True)
class Settings:
    """What changes from iteration to iteration.

    Attributes:
        std: Standard deviation of the exploration noise on the unnormalised latent.
        contact_force_penalty: Per share of the foot-substeps above the limit.
        replay_failed: Whether failed episodes are replayed from their start.
    """

    std: float
    contact_force_penalty: float
    replay_failed: bool


class HighTrainer:
    """PPO over latents on a task; a :class:`~lacoloco.pipelines.training.trainer.Trainer`."""

    def __init__(
        self,
        spec: RobotSpec,
        low: Policy,
        config: TrainHighConfig,
        *,
        seed: int,
        device: str,
        task: Task | None = None,
    ) -> None:
        """Build the hierarchy and the learner, for the robot's reach task if there is no other."""
        torch.manual_seed(seed)
        self.config = config
        self.not_reached = spec.skills.not_reached
        task = task or load_task(spec, "reach")
        command = task.command
        if isinstance(command, TargetCommand):
            command = replace(command, near=config.near_target_fraction)
        task = replace(
            task,
            command=command,
            rewards=tuple(term for term in task.rewards if config.shaped or term.name != SHAPING),
            randomisation=widened(task.randomisation, config.randomisation),
            reset=replace(task.reset, stood_s=config.stood_s),
            fall_tilt=spec.terminations.training_tilt,
        )
        if config.shift:
            task = IN_TRAINING.apply(task)
        env = LeggedEnv(spec, task, config.worlds, seed=seed, device=device)
        # Evenly among the worlds: PPO orders them by how often they act on the mean.
        place = torch.arange(config.worlds, device=device)
        share = config.noise_free_fraction
        env.set_noise_free(((place + 1) * share).long() > (place * share).long())
        self.latent_dim = low.head.sizes["latent"]
        low_sees, high_sees = low.head.observation, config.observation.of_policy
        self.env = LatentSteeredEnv(env, low, self.latent_dim, low_sees, high_sees)
        env.stagger_by(HOLD_STEPS)
        sizes = {POLICY: width(self.env.terms)}
        self.algorithm = Ppo(
            sizes,
            self.latent_dim,
            config.worlds,
            config.ppo,
            config.networks,
            device,
            critic_only(env, config.observation),
        )
        # What a pretrained policy does would change with its statistics before it has learnt.
        self.pretrains = config.skill_dynamics.rounds > 0 and isinstance(command, TargetCommand)
        self.algorithm.keeps_normalizer = self.pretrains
        self.head = Head(
            "high", sizes, self.latent_dim, config.networks, layout(self.env.terms), task.name
        )
        self.samples_per_iteration = config.worlds * config.ppo.horizon * HOLD_STEPS
        self.generator = torch.Generator(device).manual_seed(seed + 1)
        self.restarts = EpisodeRestarts(
            env, self.latent_dim, config.restart_probability, seed=seed + 2, hold=HOLD_STEPS
        )
        self.algorithm.warm_up(self._random_observations())

    def pretrain(self, log: PretrainingLog | None = None) -> dict[str, float]:
        """Begin with a policy that chooses latents by where they are predicted to lead, and tell
        ``log`` the steps.

        Every process has its own worlds, but the first one's policy counts.

        Returns:
            ``model_error``, of where the end effector is predicted to come to [m];
            ``predicted_distance`` of it from targets [m]; nothing for a task without a target.
        """
        config, command = self.config.skill_dynamics, self.env.env.task.command
        if not isinstance(command, TargetCommand):
            return {}
        log = log or PretrainingLog()
        steps = config.decisions + config.model_steps + config.policy_steps
        log.start("learning what latents do", config.rounds * steps)
        columns = {row["name"]: slice(*row["slice"]) for row in self.head.layout}
        model = SkillDynamics(self.head.sizes[POLICY], self.latent_dim, columns).to(self.env.device)
        actor, trials, metrics = self.algorithm.actor, None, dict[str, float]()
        for _ in range(config.rounds):
            trials = self._more_trials(trials, log)
            actor.update_normalization(
                TensorDict({POLICY: trials.obs}, batch_size=[len(trials.obs)])
            )
            error = fit_dynamics(model, trials, config, self.generator, log.advance)
            distance = fit_policy(
                actor, model, trials, command, columns, config, self.generator, log.advance
            )
            metrics = {"model_error": error, "predicted_distance": distance}
        log.stop()
        parallel.copy_from_first(actor)
        return metrics

    def _more_trials(self, before: Trials | None, log: PretrainingLog) -> Trials:
        """Those of before, and of another round in which the policy has a share from the second."""
        policy = None if before is None else self._mean_latent
        config = self.config.skill_dynamics
        trials = try_latents(self.env, config, self.generator, policy, log.advance)
        return trials if before is None else before.joined(trials)

    @torch.no_grad()
    def _mean_latent(self, obs: torch.Tensor) -> torch.Tensor:
        return project(self.algorithm.actor(TensorDict({POLICY: obs}, batch_size=[len(obs)])))

    @property
    def iterations(self) -> int:
        """Iterations that the budget of decisions allows."""
        return max(1, round(self.config.decisions / (self.config.worlds * self.config.ppo.horizon)))

    def iterate(self, progress: float) -> dict[str, float]:
        """One rollout and its update."""
        settings = self._schedule(progress)
        obs, accumulator = self._rollout(settings)
        self.restarts.redraw_new()
        metrics = self._update(obs)
        return (
            metrics | self._rollout_metrics(accumulator) | {"std": mean_std(self.algorithm.actor)}
        )

    def _schedule(self, progress: float) -> Settings:
        """Settings of one iteration; those of the learner are set."""
        config, algorithm = self.config, self.algorithm
        algorithm.actor_learns = not self.pretrains or progress >= config.critic_warmup
        algorithm.desired_kl = config.ppo.desired_kl * annealed(config.kl_anneal, progress)
        std = geometric(config.std, progress)
        set_std(algorithm.actor, std)
        algorithm.exploration.high_noise_scale = config.std[0] / std
        penalty = config.contact_force_penalty or 0.0
        return Settings(
            std=std,
            contact_force_penalty=penalty * ramp(progress, *config.contact_force_penalty_ramp),
            replay_failed=progress >= config.replay_failed_from,
        )

    def _rollout(self, settings: Settings) -> tuple[TensorDict, MetricAccumulator]:
        """Record one rollout; returns the observations that follow it and sums over it."""
        accumulator, obs = MetricAccumulator(), self._observe()
        for _ in range(self.config.ppo.horizon):
            self.restarts.snapshot(self.env.latent)
            decision = self.env.step(project(self.algorithm.act(obs)))
            next_obs = self._observe()
            reward = self._reward(decision, settings)
            self.algorithm.record(reward, decision.fell, decision.timed_out, next_obs)
            # A restarted episode is not counted: it belongs to an episode counted before.
            whole = decision.done & ~self.restarts.restarted
            self._end_episodes(decision, settings)
            obs = self._observe() if perhaps_any(decision.done) else next_obs
            accumulator.add(**self._outcome(decision, whole))
        return obs, accumulator

    def _reward(self, decision: Decision, settings: Settings) -> torch.Tensor:
        config = self.config
        reward = decision.reward * config.reward_scale - config.fall_penalty * decision.fell
        return reward - settings.contact_force_penalty * decision.violation

    def _end_episodes(self, decision: Decision, settings: Settings) -> None:
        failed = decision.timed_out & (decision.error > self.not_reached)
        self.env.latent = self.restarts.reset(
            decision.done,
            decision.fell,
            failed if settings.replay_failed else None,
            start=self.env.reset,
        )

    def _outcome(self, decision: Decision, whole: torch.Tensor) -> dict[str, torch.Tensor]:
        """Sums over the worlds, after the reset."""
        return {
            "reward": decision.reward.mean(),
            "falls": (decision.fell & whole).sum(),
            "ended": whole.sum(),
            # The end effector of a diverged world is nowhere.
            "measured": (whole & ~decision.diverged).sum(),
            "errors": torch.where(whole & ~decision.diverged, decision.error, 0.0).sum(),
            "speed": self.env.env.state.lin_vel_b[:, :2].norm(dim=-1).mean(),
            "above": decision.above_limit.mean(dim=1).sum(),
            "substeps": decision.substeps.sum(),
        }

    def _update(self, obs: TensorDict) -> dict[str, float]:
        """Learn from the rollout; ``obs`` are the observations after it."""
        algorithm = self.algorithm
        algorithm.compute_returns(obs)
        usage = latent_usage(project(algorithm.storage.distribution_params[0].flatten(0, 1)))
        return algorithm.update() | usage

    def _rollout_metrics(self, accumulator: MetricAccumulator) -> dict[str, float]:
        sums = accumulator.read()
        metrics = {name: sums[name] / self.config.ppo.horizon for name in ("reward", "speed")}
        metrics["contact_violation"] = sums["above"] / max(sums["substeps"], 1.0)
        metrics["episodes"] = sums["ended"]
        if sums["measured"] and self.env.env.task.has_target:
            metrics["final_error"] = sums["errors"] / sums["measured"]
        if sums["ended"]:
            metrics["falls_per_episode"] = sums["falls"] / sums["ended"]
        return metrics

    def policy(self) -> Policy:
        """The trained actor, deterministic; its output is projected to the sphere by all that use
        it.
        """
        return Policy(self.head, self.algorithm.actor.eval())

    def state_dict(self) -> dict[str, Any]:
        """See :class:`lacoloco.pipelines.training.trainer.Trainer`."""
        return {
            "algorithm": self.algorithm.save(),
            "env": self.env.env.state_dict(),
            "latent": self.env.latent,
            "restarts": self.restarts.state_dict(),
        }

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """See :class:`lacoloco.pipelines.training.trainer.Trainer`."""
        self.algorithm.load(state["algorithm"], None, True)
        self.env.env.load_state_dict(state["env"])
        self.env.latent = state["latent"].to(self.env.device)
        self.restarts.load_state_dict(state["restarts"])

    def _observe(self) -> TensorDict:
        groups = {POLICY: self.env.observe()} | for_critic(self.env.env, self.config.observation)
        return TensorDict(groups, batch_size=[self.env.num_worlds])

    def _random_observations(self) -> TensorDict:
        seen: list[Any] = []
        for _ in range(8):
            z = project(torch.randn(self.env.num_worlds, self.latent_dim, device=self.env.device))
            decision = self.env.step(z)
            self.env.reset(decision.done)
            seen.append(self._observe())
        return cast("TensorDict", torch.cat(seen))
