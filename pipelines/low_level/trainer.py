"""The low level's training: ASE on the imitation task, begun with cloned clips."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, cast

import torch
from tensordict import TensorDict

from lacoloco.datasets.motion_library import MotionLibrary
from lacoloco.pipelines.evaluation.robustness import latent_switching_robustness
from lacoloco.pipelines.learn import parallel
from lacoloco.pipelines.learn.ase import LATENT, POLICY, Ase
from lacoloco.pipelines.learn.cat import ramp, soft_terminations
from lacoloco.pipelines.learn.latents import LatentSchedule
from lacoloco.pipelines.learn.metric_accumulator import MetricAccumulator
from lacoloco.pipelines.learn.networks import annealed, mean_std, set_std
from lacoloco.pipelines.low_level.cell_balance import balanced
from lacoloco.pipelines.low_level.checkpoint_selection import Selection
from lacoloco.pipelines.low_level.cloned_start import ClonedStart
from lacoloco.pipelines.low_level.config import TrainLowConfig
from lacoloco.pipelines.low_level.training_task import training_task
from lacoloco.pipelines.policies import Head, Policy
from lacoloco.pipelines.sim.env import LeggedEnv
from lacoloco.pipelines.sim.episode_restarts import EpisodeRestarts
from lacoloco.pipelines.sim.physics import CONTROL_DT
from lacoloco.pipelines.sim.state import RobotState, layout, style_frame, width
from lacoloco.pipelines.training.critic import critic_only, for_critic
from lacoloco.pipelines.training.pretraining import PretrainingLog
from lacoloco.robots.spec import RobotSpec

LONG_HORIZON_S = 10.0
"""Length of the episodes of the reach task [s]."""


class LowTrainer:
    """ASE on the imitation task; see :class:`lacoloco.pipelines.training.trainer.Trainer`."""

    def __init__(
        self,
        spec: RobotSpec,
        library: MotionLibrary,
        config: TrainLowConfig,
        *,
        seed: int,
        device: str,
        experts: Mapping[str, Policy] | None = None,
    ) -> None:
        """Build environment, latents and learner.

        Args:
            spec: The robot.
            library: The clips.
            config: Settings.
            seed: Seed of everything random.
            device: Where physics and learning run.
            experts: Task -> the policy that performed its clips, for ``config.expert_rounds``.

        Raises:
            StageError: There are to be such rounds, and no clip says what an expert was commanded.
        """
        torch.manual_seed(seed)
        self.motions = balanced(spec, library, config.cell_balance)
        self.config, self.spec, self.seed = config, spec, seed
        self.env = LeggedEnv(
            spec,
            training_task(spec, config),
            config.worlds,
            seed=seed,
            device=device,
            motions=self.motions,
            observation=config.observation.of_policy,
        )
        self.env.stagger()
        self.latents = LatentSchedule(config.worlds, config.latents, seed=seed + 1, device=device)
        self.restarts = EpisodeRestarts(
            self.env, config.latents.dim, config.restart_probability, seed=seed + 4
        )
        self.long_horizon = (
            torch.arange(config.worlds, device=device)
            < config.long_horizon_fraction * config.worlds
        )
        self.terminations = soft_terminations(
            {c.name: c.max_p for c in self.env.task.constraints}, config.cat_scale
        )
        self.generator = torch.Generator(device).manual_seed(seed + 2)
        sizes = {POLICY: width(self.env.terms), LATENT: config.latents.dim}
        self.algorithm = Ase(
            sizes,
            self.env.num_actions,
            config.worlds,
            self.demonstrations,
            ppo=config.ppo,
            networks=config.networks,
            ase=config.ase,
            seed=seed + 3,
            device=device,
            critic_only=critic_only(self.env, config.observation),
        )
        self.start = self._cloned_start(library, experts or {}) if config.bc_steps else None
        self.head = Head(
            "low", sizes, self.env.num_actions, config.networks, layout(self.env.terms), "imitate"
        )
        self.selection = Selection(
            spec, library, self.head, latents=config.coverage_latents, seed=seed
        )
        self.samples_per_iteration = config.worlds * config.ppo.horizon
        self.recent_falls: list[float] = []
        self.algorithm.warm_up(self._first_observations())
        self.algorithm.keeps_normalizer = config.bc_steps > 0

    def _cloned_start(self, library: MotionLibrary, experts: Mapping[str, Policy]) -> ClonedStart:
        config, seed = self.config, self.seed + 5
        start = ClonedStart(self.env, library, self.motions, config, experts, self.generator, seed)
        self.algorithm.labelled = start.labelled
        if start.goes_on:
            self.algorithm.answers = start.answers
        return start

    @property
    def iterations(self) -> int:
        """Iterations that the budget of samples allows."""
        return max(1, round(self.config.samples / self.samples_per_iteration))

    def pretrain(self, log: PretrainingLog | None = None) -> dict[str, float]:
        """Begin with a policy whose latents reproduce the clips, and an encoder that reads them off
        the clips.

        Args:
            log: Is told the steps; keeps every round of questions, and the last fit.

        Returns:
            The error of the cloned actions (raw units, rms) and the encoder's mean cosine; with
            rounds of questions to the experts also the falls per 1000 steps in the last round, and
            the share of episodes under switching latents that end in a fall.
        """
        config, actor, start = self.config, self.algorithm.actor, self.start
        assert start is not None, "nothing is to be cloned"
        metrics = start.fit(actor, log or PretrainingLog())
        if config.expert_rounds:
            cloned = Policy(self.head, actor)
            switching = latent_switching_robustness(self.spec, cloned, seed=self.seed)
            metrics["cloned_switching_fall_rate"] = switching["switching_fall_rate"]
        parallel.copy_from_first(actor, start.embedding)
        return metrics | {"clone_cosine": self.algorithm.fit_encoder(config.bc_steps // 4)}

    def demonstrations(self, count: int) -> torch.Tensor:
        """(count, 2F) clean style transitions of the clips, older frame first, like the agent's
        (the original has the two in opposite orders).
        """
        before, after = self.motions.sample_transitions(count, CONTROL_DT, generator=self.generator)
        return torch.cat(
            [style_frame(RobotState.from_motion(frames)) for frames in (before, after)], dim=-1
        )

    def iterate(self, progress: float) -> dict[str, float]:
        """One rollout and its update."""
        strength = self._schedule(progress)
        obs, accumulator = self._rollout(strength)
        self.restarts.redraw_new()
        self.algorithm.compute_returns(obs)
        metrics = self.algorithm.update()
        sums = accumulator.read()
        self.recent_falls.append(sums["falls"] * parallel.size())
        return metrics | self._examine(progress) | self._rollout_metrics(sums)

    def _schedule(self, progress: float) -> float:
        """Set what changes from iteration to iteration; returns the strength of the constraint."""
        config, algorithm = self.config, self.algorithm
        if progress >= config.long_horizon_from:
            self._lengthen_episodes()
        algorithm.actor_learns = not config.bc_steps or progress >= config.critic_warmup
        set_std(algorithm.actor, config.exploration_std)
        algorithm.desired_kl = config.ppo.desired_kl * annealed(config.kl_anneal, progress)
        return ramp(progress, *config.cat_ramp) if config.cat else 0.0

    def _rollout(self, strength: float) -> tuple[TensorDict, MetricAccumulator]:
        """Record one rollout; returns the observations that follow it and sums over it."""
        env, algorithm, accumulator = self.env, self.algorithm, MetricAccumulator()
        frame, obs = env.frame(), self._observe()
        for _ in range(self.config.ppo.horizon):
            self.restarts.snapshot(self.latents.z)
            step = env.step(algorithm.act(obs))
            next_obs = self._observe()
            delta = self.terminations(step.violations, strength) if step.violations else None
            violated = self.terminations.violated.items()
            algorithm.record_transition(frame, step.frame, step.valid)
            algorithm.record(step.reward, step.fell, step.timed_out, next_obs, delta)
            accumulator.add(
                falls=(step.fell & ~self.restarts.restarted).sum(),
                speed=env.state.lin_vel_b[:, :2].norm(dim=-1).mean(),
                delta=None if delta is None else delta.mean(),
                **{f"violation_{name}": share for name, share in violated},
            )
            self.latents.z = self.restarts.reset(step.done, step.fell, start=self._start_episodes)
            frame, obs = env.frame(), self._observe()
        self.terminations.end_batch()
        return obs, accumulator

    def _start_episodes(self, done: torch.Tensor) -> torch.Tensor:
        self.env.reset(done)
        self.latents.advance(done)
        return self.latents.z

    def _rollout_metrics(self, sums: Mapping[str, float]) -> dict[str, float]:
        horizon = self.config.ppo.horizon
        violations = [name for name in sums if name.startswith("violation_")]
        return {
            "speed": sums["speed"] / horizon,
            "falls_per_1000_steps": 1000.0 * sums["falls"] / self.samples_per_iteration,
            "delta": sums.get("delta", 0.0) / horizon,
            **{name: sums[name] / horizon for name in violations},
            **{
                f"c_max_{name}": float(worst.max())
                for name, worst in self.terminations.c_max.items()
            },
            "std": mean_std(self.algorithm.actor),
        }

    def _lengthen_episodes(self) -> None:
        self.env.set_episodes(self.long_horizon, LONG_HORIZON_S, clip_share=0.0)
        self.latents.random_walk = self.long_horizon

    def _examine(self, progress: float) -> dict[str, float]:
        done = round(progress * self.iterations) + 1
        before, after = (count * self.samples_per_iteration for count in (done - 1, done))
        every, last = self.config.coverage_every, done == self.iterations
        if parallel.rank() or not last and not (every and after // every > before // every):
            return {}
        actor = self.algorithm.actor
        if not last and progress < self.config.choose_from:
            return self.selection.measure(actor)
        metrics = self.selection.examine(actor, after * parallel.size())
        # The last warnings are of the policy that is kept.
        return self.selection.confirm(actor) if last else metrics

    def closing_metrics(self) -> dict[str, float]:
        """What is known at the end only.

        Returns:
            Falls in the last hundredth of the samples; the clips' mean planar speed [m/s], to
            compare with ``speed``; worlds that diverged.
        """
        last = max(1, len(self.recent_falls) // 100)
        frames = self.demonstrations(16384)[:, : self.algorithm.transitions.shape[-1] // 2]
        return {
            "falls_last_1pct": sum(self.recent_falls[-last:]),
            "clip_speed": float(frames[:, 4:6].norm(dim=-1).mean()),
            "diverged_worlds": float(self.env.diverged_total),
        }

    def policy(self) -> Policy:
        """The best actor seen, deterministic."""
        return Policy(self.head, self.selection.best(self.algorithm.actor))

    def state_dict(self) -> dict[str, Any]:
        """See :class:`lacoloco.pipelines.training.trainer.Trainer`."""
        return {
            "algorithm": self.algorithm.save(),
            "env": self.env.state_dict(),
            "latents": self.latents.state_dict(),
            "terminations": self.terminations.state_dict(),
            "restarts": self.restarts.state_dict(),
            "generator": self.generator.get_state(),
            "recent_falls": self.recent_falls,
            "chosen": self.selection.chosen,
            **(self.start.state_dict() if self.start is not None else {}),
        }

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """See :class:`lacoloco.pipelines.training.trainer.Trainer`."""
        self.algorithm.load(state["algorithm"])
        self.env.load_state_dict(state["env"])
        self.latents.load_state_dict(state["latents"])
        self.terminations.load_state_dict(state["terminations"])
        self.restarts.load_state_dict(state["restarts"])
        self.generator.set_state(state["generator"])
        self.recent_falls = list(state["recent_falls"])
        self.selection.chosen = state["chosen"]
        if self.start is not None:
            self.start.load_state_dict(state)

    def _observe(self) -> TensorDict:
        groups = {POLICY: self.env.observe(), LATENT: self.latents.z}
        groups |= for_critic(self.env, self.config.observation)
        return TensorDict(groups, batch_size=[self.env.num_worlds])

    def _first_observations(self) -> TensorDict:
        # With actions: columns of the last action that never moved would be scaled up a
        # hundredfold.
        seen: list[Any] = []
        for _ in range(8):
            self.env.reset(
                torch.ones(self.env.num_worlds, dtype=torch.bool, device=self.env.device)
            )
            for _ in range(4):
                spread = self.config.exploration_std * torch.randn(
                    self.env.num_worlds, self.env.num_actions, device=self.env.device
                )
                self.env.step(spread)
                seen.append(self._observe())
        self.env.stagger()
        return cast("TensorDict", torch.cat(seen))
