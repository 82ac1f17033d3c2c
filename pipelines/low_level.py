"""The low level's training: ASE on the imitation task, begun with cloned clips."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any

import torch
from tensordict import TensorDict

from lacoloco.datasets.motion_library import MotionLibrary
from lacoloco.pipelines.learn import parallel
from lacoloco.pipelines.learn.ase import LATENT, POLICY, Ase, AseConfig
from lacoloco.pipelines.learn.cat import SoftTerminations, ramp
from lacoloco.pipelines.learn.cloning import Teacher, clone
from lacoloco.pipelines.learn.latents import LatentConfig, LatentSchedule
from lacoloco.pipelines.learn.networks import NetworkConfig, geometric, set_std
from lacoloco.pipelines.learn.ppo import PpoConfig
from lacoloco.pipelines.learn.skill_embedding import (
    LabelledTransitions,
    SkillEmbedding,
    WindowConfig,
)
from lacoloco.pipelines.learn.tally import Tally
from lacoloco.pipelines.policies import Head, Policy
from lacoloco.pipelines.selection import Selection
from lacoloco.pipelines.sim.env import LeggedEnv
from lacoloco.pipelines.sim.physics import CONTROL_DT
from lacoloco.pipelines.sim.randomisation import widened
from lacoloco.pipelines.sim.retries import Retries
from lacoloco.pipelines.sim.state import RobotState, layout, noise_scale, style_frame, width
from lacoloco.pipelines.sim.tasks import Task, imitate_task
from lacoloco.pipelines.warm_start import clip_states, infer_actions, previous_actions
from lacoloco.pipelines.worlds import put, select
from lacoloco.robots.spec import RobotSpec

REHEARSAL_S = 10.0
"""Length of the episodes of the reach task [s]."""


@dataclass(frozen=True)
class TrainLowConfig:
    """Low-level training.

    Attributes:
        cat: constrain the foot forces (Constraints as Terminations).
        cat_ramp: shares of the training between which the constraint rises to full strength.
        clip_share: share of resets that start inside a clip.
        episode_s: seconds until a time-out. Far shorter than the original's 10 s: a policy that cannot walk yet leaves a
            clip's motion within tenths of a second, and only just after a reset can it learn to stay in it longer.
        rehearsal: share of the worlds that live as they will under a high level: ``REHEARSAL_S`` from a standing start, with
            latents that wander, slowly in some worlds and fast in others.
        rehearsal_from: share of the training after which they do. A beginner that falls at every change learns to stand.
        randomisation: factor on the spread of masses and centres of mass; evaluation is at 1.
        second_chances: share of falls after which the world is put back to shortly before, again and again.
        push: how hard the robot is pushed, where it is at all [m/s, rad/s]; evaluation pushes with 0.25.
        push_every_s: seconds between two pushes.
        std: exploration std at the start and at the end, in raw action units (x action scale = rad).
        std_between: shares of the training between which it falls from the first to the second.
        warm_start: gradient steps of behaviour cloning on actions inferred from the clips, before everything else; 0 begins
            with a random network and meaningless latents, as the paper does.
        head_start: share of the training in which critic, discriminator and encoder learn alone. What was cloned is precise to
            a fraction of the exploration std, and the first advantages of an untrained critic would undo it.
        windows: what a latent describes while the clips are cloned.
        skill_shares: skill name -> share of demonstrations and clip resets; empty: by duration.
        coverage_every: samples between two measurements of the deterministic skill coverage (0: only at the end).
        coverage_latents: latents held in each of them.
        choose_from: share of the training after which every policy measured may be the one that is kept (``selection.py``);
            the constraint should be in force by then.
    """

    worlds: int = 512
    samples: int = 3_000_000
    cat: bool = True
    cat_ramp: tuple[float, float] = (0.6, 0.8)
    clip_share: float = 0.7
    episode_s: float = 2.0
    rehearsal: float = 0.5
    rehearsal_from: float = 0.3
    randomisation: float = 1.25
    second_chances: float = 0.9
    push: float = 0.3
    push_every_s: tuple[float, float] = (1.0, 3.0)
    std: tuple[float, float] = (0.05, 0.05)
    std_between: tuple[float, float] = (0.4, 0.9)
    warm_start: int = 1000
    head_start: float = 0.03
    windows: WindowConfig = field(default_factory=WindowConfig)
    skill_shares: tuple[tuple[str, float], ...] = ()
    coverage_every: int = 250_000
    coverage_latents: int = 256
    choose_from: float = 0.8
    latents: LatentConfig = field(default_factory=LatentConfig)
    ppo: PpoConfig = field(
        default_factory=lambda: PpoConfig(horizon=16, epochs=4, minibatches=2, gamma=0.98, desired_kl=0.02, learning_rate=5e-5)
    )
    networks: NetworkConfig = field(default_factory=NetworkConfig)
    ase: AseConfig = field(default_factory=AseConfig)


class LowTrainer:
    """ASE on the imitation task; see :class:`lacoloco.pipelines.training.Trainer`."""

    def __init__(
        self, spec: RobotSpec, library: MotionLibrary, config: TrainLowConfig, *, seed: int, device: str
    ) -> None:
        """Build environment, latents and learner."""
        torch.manual_seed(seed)
        self.config, self.spec, self.motions, self.seed = config, spec, library, seed
        self.env = LeggedEnv(spec, _task(spec, config), config.worlds, seed=seed, device=device, motions=library)
        self.env.stagger()
        self.latents = LatentSchedule(config.worlds, config.latents, seed=seed + 1, device=device)
        self.retries = Retries(self.env, config.latents.dim, config.second_chances, seed=seed + 4)
        self.rehearsing = torch.arange(config.worlds, device=device) < config.rehearsal * config.worlds
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
        self.head = Head("low", sizes, self.env.num_actions, config.networks, layout(self.env.terms), "imitate")
        self.selection = Selection(spec, library, self.head, latents=config.coverage_latents, seed=seed)
        self.samples_per_iteration = config.worlds * config.ppo.horizon
        self.recent_falls: list[float] = []
        self.algorithm.warm_up(self._first_observations())

    @property
    def iterations(self) -> int:
        """Iterations that the budget of samples allows."""
        return max(1, round(self.config.samples / self.samples_per_iteration))

    def warm_start(self) -> dict[str, float]:
        """Begin with a policy whose latents reproduce the clips, and an encoder that reads them off the clips.

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
            self.algorithm.actor, self.embedding, teacher, self._starts, steps=config.warm_start, draw=self.draw
        )
        parallel.copy_from_first(self.algorithm.actor, self.embedding)
        return {"clone_error": error, "clone_cosine": self.algorithm.fit_encoder(config.warm_start // 4)}

    def demonstrations(self, count: int) -> torch.Tensor:
        """(count, 2F) clean style transitions of the clips, older frame first, like the agent's (facts 9.2, B1)."""
        before, after = self.motions.sample_transitions(count, CONTROL_DT, generator=self.draw)
        return torch.cat([style_frame(RobotState.from_motion(frames)) for frames in (before, after)], dim=-1)

    def iterate(self, progress: float) -> dict[str, float]:
        """One rollout and its update."""
        config, env, algorithm = self.config, self.env, self.algorithm
        if progress >= config.rehearsal_from:
            self._rehearse()
        algorithm.actor_learns = not config.warm_start or progress >= config.head_start
        std = geometric(config.std, ramp(progress, *config.std_between))
        set_std(algorithm.actor, std)
        strength = ramp(progress, *config.cat_ramp) if config.cat else 0.0
        tally = Tally()
        frame, obs = env.frame(), self._observe()
        for _ in range(config.ppo.horizon):
            self.retries.keep(self.latents.z)
            step = env.step(algorithm.act(obs))
            next_obs = self._observe()
            delta = self.terminations(step.violations, strength) if step.violations else None
            algorithm.record_transition(frame, step.frame, step.valid)
            algorithm.record(step.reward, step.fell, step.timed_out, next_obs, delta)
            speed = env.state.lin_vel_b[:, :2].norm(dim=-1).mean()
            tally.add(falls=step.fell.sum(), speed=speed, delta=None if delta is None else delta.mean())
            tally.add(**{f"violation_{name}": share for name, share in self.terminations.violated.items()})
            again = self.retries.choose(step.fell)
            env.reset(step.done)
            self.latents.advance(step.done)
            self.latents.z = self.retries.put_back(again, self.latents.z)
            frame, obs = env.frame(), self._observe()
        algorithm.compute_returns(obs)
        figures = algorithm.update()
        sums = tally.read()
        self.recent_falls.append(sums["falls"] * parallel.size())
        return figures | self._examine(progress) | {
            "speed": sums["speed"] / config.ppo.horizon,
            "falls_per_1000_steps": 1000.0 * sums["falls"] / self.samples_per_iteration,
            "delta": sums.get("delta", 0.0) / config.ppo.horizon,
            **{name: sums[name] / config.ppo.horizon for name in sums if name.startswith("violation_")},
            **{f"c_max_{name}": float(worst.max()) for name, worst in self.terminations.c_max.items()},
            "std": std,
        }

    def _rehearse(self) -> None:
        worlds = select(self.rehearsing)
        put(self.env.episode_steps, worlds, round(REHEARSAL_S / CONTROL_DT))
        put(self.env.clip_share, worlds, 0.0)
        self.latents.wandering = self.rehearsing

    def _starts(self, count: int) -> torch.Tensor:
        """(count,) rows of the clips' states, drawn as demonstrations are."""
        return self.clips.rows(*self.motions.sample(count, generator=self.draw, margin=CONTROL_DT))

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
            Falls in the last hundredth of the samples; the clips' mean planar speed [m/s], to compare with ``speed``; worlds
            that diverged; after how many samples the chosen policy was seen, and its coverage.
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
        """See :class:`lacoloco.pipelines.training.Trainer`."""
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
        """See :class:`lacoloco.pipelines.training.Trainer`."""
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
        return TensorDict({POLICY: self.env.observe(), LATENT: self.latents.z}, batch_size=[self.env.num_worlds])

    def _first_observations(self) -> TensorDict:
        # With actions: columns of the last action that never moved would be scaled up a hundredfold.
        seen = []
        for _ in range(8):
            self.env.reset(torch.ones(self.env.num_worlds, dtype=torch.bool, device=self.env.device))
            for _ in range(4):
                spread = self.config.std[0] * torch.randn(self.env.num_worlds, self.env.num_actions, device=self.env.device)
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
    return replace(task, episode_s=config.episode_s, reset=reset, randomisation=around)
