"""The low level's training: ASE on the imitation task, begun with cloned clips."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import torch
from tensordict import TensorDict

from lacoloco.datasets.motion_library import MotionLibrary
from lacoloco.pipelines.learn import parallel
from lacoloco.pipelines.learn.ase import LATENT, POLICY, Ase
from lacoloco.pipelines.learn.behaviour_cloning import Teacher, clone
from lacoloco.pipelines.learn.cat import SoftTerminations, ramp
from lacoloco.pipelines.learn.latents import LatentSchedule
from lacoloco.pipelines.learn.metric_accumulator import Tally
from lacoloco.pipelines.learn.networks import geometric, set_std
from lacoloco.pipelines.learn.skill_embedding import LabelledTransitions, SkillEmbedding
from lacoloco.pipelines.low_level.checkpoint_selection import Selection
from lacoloco.pipelines.low_level.config import TrainLowConfig
from lacoloco.pipelines.masking import put, select
from lacoloco.pipelines.policies import Head, Policy
from lacoloco.pipelines.sim.clip_actions import clip_states, infer_actions, previous_actions
from lacoloco.pipelines.sim.env import LeggedEnv
from lacoloco.pipelines.sim.episode_restarts import Retries
from lacoloco.pipelines.sim.physics import CONTROL_DT
from lacoloco.pipelines.sim.randomisation import widened
from lacoloco.pipelines.sim.state import RobotState, layout, noise_scale, style_frame, width
from lacoloco.pipelines.sim.tasks import Task, imitate_task
from lacoloco.robots.spec import RobotSpec

REHEARSAL_S = 10.0
"""Length of the episodes of the reach task [s]."""


class LowTrainer:
    """ASE on the imitation task; see :class:`lacoloco.pipelines.training.loop.Trainer`."""

    def __init__(
        self,
        spec: RobotSpec,
        library: MotionLibrary,
        config: TrainLowConfig,
        *,
        seed: int,
        device: str,
    ) -> None:
        """Build environment, latents and learner."""
        torch.manual_seed(seed)
        self.config, self.spec, self.motions, self.seed = config, spec, library, seed
        self.env = LeggedEnv(
            spec, _task(spec, config), config.worlds, seed=seed, device=device, motions=library
        )
        self.env.stagger()
        self.latents = LatentSchedule(config.worlds, config.latents, seed=seed + 1, device=device)
        self.retries = Retries(self.env, config.latents.dim, config.second_chances, seed=seed + 4)
        self.rehearsing = (
            torch.arange(config.worlds, device=device) < config.rehearsal * config.worlds
        )
        self.terminations = SoftTerminations({c.name: c.max_p for c in self.env.task.constraints})
        self.draw = torch.Generator(device).manual_seed(seed + 2)
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
        )
        if config.warm_start:
            self.clips = clip_states(library)
            timeline = self.clips.timeline()
            self.embedding = SkillEmbedding(timeline, config.latents.dim, config.windows)
            self.algorithm.labelled = LabelledTransitions(timeline, self.embedding, self._starts)
        self.head = Head(
            "low", sizes, self.env.num_actions, config.networks, layout(self.env.terms), "imitate"
        )
        self.selection = Selection(
            spec, library, self.head, latents=config.coverage_latents, seed=seed
        )
        self.samples_per_iteration = config.worlds * config.ppo.horizon
        self.recent_falls: list[float] = []
        self.algorithm.warm_up(self._first_observations())

    @property
    def iterations(self) -> int:
        """Iterations that the budget of samples allows."""
        return max(1, round(self.config.samples / self.samples_per_iteration))

    def warm_start(self) -> dict[str, float]:
        """Begin with a policy whose latents reproduce the clips, and an encoder that reads them off
        the clips.

        Returns:
            The error of the cloned actions (raw units, rms) and the encoder's mean cosine.
        """
        config, env = self.config, self.env
        actions = infer_actions(self.spec, self.clips, env.task.action_scale)
        teacher = Teacher(
            self.clips.timeline().frames,
            previous_actions(self.clips, actions),
            actions,
            noise_scale(env.terms).to(env.device),
        )
        error = clone(
            self.algorithm.actor,
            self.embedding,
            teacher,
            self._cloned,
            steps=config.warm_start,
            draw=self.draw,
        )
        parallel.copy_from_first(self.algorithm.actor, self.embedding)
        return {
            "clone_error": error,
            "clone_cosine": self.algorithm.fit_encoder(config.warm_start // 4),
        }

    def demonstrations(self, count: int) -> torch.Tensor:
        """(count, 2F) clean style transitions of the clips, older frame first, like the agent's
        (facts 9.2, B1).
        """
        before, after = self.motions.sample_transitions(count, CONTROL_DT, generator=self.draw)
        return torch.cat(
            [style_frame(RobotState.from_motion(frames)) for frames in (before, after)], dim=-1
        )

    def iterate(self, progress: float) -> dict[str, float]:
        """One rollout and its update."""
        config, env, algorithm = self.config, self.env, self.algorithm
        if progress >= config.rehearsal_from:
            self._rehearse()
        algorithm.actor_learns = not config.warm_start or progress >= config.head_start
        std = geometric(config.std, ramp(progress, *config.std_between))
        set_std(algorithm.actor, std)
        calm, begin, end = config.settle
        algorithm.desired_kl = config.ppo.desired_kl * geometric(
            (1.0, calm), ramp(progress, begin, end)
        )
        strength = ramp(progress, *config.cat_ramp) if config.cat else 0.0
        tally, fresh = Tally(), torch.zeros_like(self.rehearsing)
        frame, obs = env.frame(), self._observe()
        for _ in range(config.ppo.horizon):
            self.retries.keep(self.latents.z)
            step = env.step(algorithm.act(obs))
            next_obs = self._observe()
            delta = self.terminations(step.violations, strength) if step.violations else None
            algorithm.record_transition(frame, step.frame, step.valid)
            algorithm.record(step.reward, step.fell, step.timed_out, next_obs, delta)
            speed = env.state.lin_vel_b[:, :2].norm(dim=-1).mean()
            tally.add(
                falls=(step.fell & ~self.retries.returned).sum(),
                speed=speed,
                delta=None if delta is None else delta.mean(),
            )
            tally.add(
                **{f"violation_{name}": share for name, share in self.terminations.violated.items()}
            )
            again = self.retries.choose(step.fell)
            env.reset(step.done)
            fresh |= step.done & ~again
            self.latents.advance(step.done)
            self.latents.z = self.retries.put_back(again, self.latents.z)
            frame, obs = env.frame(), self._observe()
        env.redraw(fresh)
        algorithm.compute_returns(obs)
        figures = algorithm.update()
        sums = tally.read()
        self.recent_falls.append(sums["falls"] * parallel.size())
        return (
            figures
            | self._examine(progress)
            | {
                "speed": sums["speed"] / config.ppo.horizon,
                "falls_per_1000_steps": 1000.0 * sums["falls"] / self.samples_per_iteration,
                "delta": sums.get("delta", 0.0) / config.ppo.horizon,
                **{
                    name: sums[name] / config.ppo.horizon
                    for name in sums
                    if name.startswith("violation_")
                },
                **{
                    f"c_max_{name}": float(worst.max())
                    for name, worst in self.terminations.c_max.items()
                },
                "std": std,
            }
        )

    def _rehearse(self) -> None:
        worlds = select(self.rehearsing)
        put(self.env.episode_steps, worlds, round(REHEARSAL_S / CONTROL_DT))
        put(self.env.clip_share, worlds, 0.0)
        self.latents.wandering = self.rehearsing

    def _starts(self, count: int) -> torch.Tensor:
        """(count,) rows of the clips' states, drawn as demonstrations are."""
        return self.clips.rows(*self.motions.sample(count, generator=self.draw, margin=CONTROL_DT))

    def _cloned(self, count: int) -> torch.Tensor:
        """(count,) rows at which the windows to be cloned start: some at the beginning of a clip,
        the others anywhere.
        """
        clips, times = self.motions.sample(count, generator=self.draw, margin=CONTROL_DT)
        times[: round(self.config.beginnings * count)] = 0.0
        return self.clips.rows(clips, times)

    def _examine(self, progress: float) -> dict[str, float]:
        done = round(progress * self.iterations) + 1
        before, after = (count * self.samples_per_iteration for count in (done - 1, done))
        every, last = self.config.coverage_every, done == self.iterations
        if parallel.rank() or not last and not (every and after // every > before // every):
            return {}
        actor = self.algorithm.actor
        if last or progress >= self.config.choose_from:
            return self.selection.examine(actor, after * parallel.size())
        return self.selection.measure(actor)

    def closing_figures(self) -> dict[str, float]:
        """What is known at the end only.

        Returns:
            Falls in the last hundredth of the samples; the clips' mean planar speed [m/s], to
            compare with ``speed``; worlds that diverged; after how many samples the chosen policy
            was seen, and its coverage.
        """
        last = max(1, len(self.recent_falls) // 100)
        frames = self.demonstrations(16384)[:, : self.algorithm.transitions.shape[-1] // 2]
        return {
            "falls_last_1pct": sum(self.recent_falls[-last:]),
            "clip_speed": float(frames[:, 4:6].norm(dim=-1).mean()),
            "diverged_worlds": float(self.env.diverged_total),
            "chosen_after": float(self.selection.chosen["samples"]),
            **self.selection.chosen["figures"],
        }

    def policy(self) -> Policy:
        """The best actor seen, deterministic."""
        return Policy(self.head, self.selection.best(self.algorithm.actor))

    def state_dict(self) -> dict[str, Any]:
        """See :class:`lacoloco.pipelines.training.loop.Trainer`."""
        return {
            "algorithm": self.algorithm.save(),
            "env": self.env.state_dict(),
            "latents": self.latents.state_dict(),
            "terminations": self.terminations.state_dict(),
            "retries": self.retries.state_dict(),
            "draw": self.draw.get_state(),
            "recent_falls": self.recent_falls,
            "chosen": self.selection.chosen,
        } | ({"embedding": self.embedding.state_dict()} if self.config.warm_start else {})

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """See :class:`lacoloco.pipelines.training.loop.Trainer`."""
        self.algorithm.load(state["algorithm"])
        self.env.load_state_dict(state["env"])
        self.latents.load_state_dict(state["latents"])
        self.terminations.load_state_dict(state["terminations"])
        self.retries.load_state_dict(state["retries"])
        self.draw.set_state(state["draw"])
        self.recent_falls = list(state["recent_falls"])
        self.selection.chosen = state["chosen"]
        if self.config.warm_start:
            self.embedding.load_state_dict(state["embedding"])

    def _observe(self) -> TensorDict:
        return TensorDict(
            {POLICY: self.env.observe(), LATENT: self.latents.z}, batch_size=[self.env.num_worlds]
        )

    def _first_observations(self) -> TensorDict:
        # With actions: columns of the last action that never moved would be scaled up a
        # hundredfold.
        seen = []
        for _ in range(8):
            self.env.reset(
                torch.ones(self.env.num_worlds, dtype=torch.bool, device=self.env.device)
            )
            for _ in range(4):
                spread = self.config.std[0] * torch.randn(
                    self.env.num_worlds, self.env.num_actions, device=self.env.device
                )
                self.env.step(spread)
                seen.append(self._observe())
        self.env.stagger()
        return torch.cat(seen)


def _task(spec: RobotSpec, config: TrainLowConfig) -> Task:
    task = imitate_task(spec, constrained=config.cat)
    around = widened(task.randomisation, config.randomisation)
    if around.push:
        around = replace(around, push=config.push, push_interval_s=config.push_every_s)
    reset = replace(task.reset, clip_share=config.clip_share)
    return replace(
        task,
        episode_s=config.episode_s,
        fall_tilt=spec.terminations.training_tilt,
        reset=reset,
        randomisation=around,
    )
