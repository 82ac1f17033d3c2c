"""What a low level begins with: a policy cloned from clips and from what experts say, and latents
for what it does.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from functools import cached_property
from typing import Any

import torch
from rsl_rl.models import MLPModel
from tensordict import TensorDict

from lacoloco.datasets.motion_library import MotionLibrary
from lacoloco.pipelines.learn.behaviour_cloning import CloningData
from lacoloco.pipelines.learn.skill_embedding import LabelledTransitions, SkillEmbedding
from lacoloco.pipelines.low_level.cloning import Cloning, CloningRounds
from lacoloco.pipelines.low_level.config import TrainLowConfig
from lacoloco.pipelines.low_level.expert_labels import ExpertLabels
from lacoloco.pipelines.policies import Policy
from lacoloco.pipelines.sim.clip_actions import clip_states, infer_actions, with_memory
from lacoloco.pipelines.sim.env import LeggedEnv
from lacoloco.pipelines.sim.physics import CONTROL_DT
from lacoloco.pipelines.training.pretraining import PretrainingLog

ASKED_AFTER, ALL_ASKED = 0.5, 2
"""Factors on the gradient steps of cloning, before each round of questions to the experts and after
the last one. The H1's low level fell in 39 % of the episodes after 1500 steps, in 16 % after 4000.
"""
KEPT_ANSWERS = 100_000
"""States in which experts were asked that PPO is held to; every checkpoint holds them."""


class ClonedStart:
    """The clips' states, latents for them, the experts that are asked, and the fit to all of it."""

    def __init__(
        self,
        env: LeggedEnv,
        library: MotionLibrary,
        motions: MotionLibrary,
        config: TrainLowConfig,
        experts: Mapping[str, Policy],
        generator: torch.Generator,
        seed: int,
    ) -> None:
        """Prepare it.

        Args:
            env: The training's: its robot, its scale of actions, its noise in readings.
            library: The clips.
            motions: The same, drawn as demonstrations are.
            config: Settings.
            experts: Task -> the policy that performed its clips.
            generator: Source of randomness.
            seed: Of the worlds in which experts are asked.

        Raises:
            StageError: There are to be such worlds, and no clip says what an expert was commanded.
        """
        self.motions, self.config = motions, config
        self._env, self._generator = env, generator
        self.clips = clip_states(library)
        self.embedding = SkillEmbedding(self.clips.flattened(), config.latents.dim, config.windows)
        self.labels: ExpertLabels | None = None
        if config.expert_rounds:
            self.labels = ExpertLabels(
                env.spec,
                library,
                self.clips,
                experts,
                worlds=config.expert_worlds,
                hold_steps=config.latents.max_steps,
                seed=seed,
                shifted=bool(config.shift),
            )

    @property
    def labelled(self) -> LabelledTransitions:
        """The clips' transitions with their latents."""
        return LabelledTransitions(self.clips.flattened(), self.embedding, self.starts)

    @property
    def goes_on(self) -> bool:
        """Whether PPO is held to what the experts said."""
        return self.labels is not None and self.config.ase.label_weight > 0.0

    def answers(self, count: int) -> tuple[TensorDict, torch.Tensor]:
        """See :meth:`~lacoloco.pipelines.low_level.cloning.Cloning.answers`."""
        return self.cloning.answers(count)

    def fit(self, actor: MLPModel, log: PretrainingLog) -> dict[str, float]:
        """Fit the actor to the clips, ask the experts and fit again; returns what that came to."""
        config = self.config
        rounds = CloningRounds(self.cloning, actor, self.labels)
        asked = config.expert_rounds or 0
        before = round(ASKED_AFTER * config.bc_steps)
        last = config.bc_steps * (ALL_ASKED if asked else 1)
        answers = self.labels.steps if self.labels is not None else 0
        log.start("cloning the clips", asked * (before + answers) + last)
        for number in log.rounds(rounds, asked + 1):
            watch = log.fitting(number)
            if number <= asked:
                self.cloning.fit(actor, before, watch)
                falls = rounds.ask(self._env.noise_scale, config.exploration_std, log.advance)
                log.advance(0, falls_per_1000_steps=falls)
            else:
                rounds.metrics["clone_error"] = self.cloning.fit(actor, last, watch)
                self.cloning.forget(KEPT_ANSWERS if self.goes_on else 0)
        log.stop()
        return dict(rounds.metrics)

    @cached_property
    def cloning(self) -> Cloning:
        """The clips as data to clone."""
        config, env = self.config, self._env
        moves = infer_actions(env.spec, self.clips, env.task.action_scale)
        actions, previous = with_memory(self.clips, moves, env.task.memory)
        noise = env.noise_scale
        data = CloningData(
            self.clips.flattened().frames,
            previous,
            actions,
            noise,
            before=self.clips.before,
            history=config.observation.of_policy.history,
            columns=None if env.view is None else env.view.columns,
        )
        if config.expert_rounds:
            # Who is asked knows the state and the last action. Fitted to noisy views of them, the
            # answers shrink: small corrections that keep a robot up, and steps from the last action
            # by which an arm is led.
            data = replace(data, noise=torch.zeros_like(noise), action_noise=0.0)
        scattered = config.latent_noise if config.expert_rounds else 0.0
        return Cloning(
            self.clips, self.embedding, data, self.cloned, self._generator, latent_noise=scattered
        )

    def state_dict(self) -> dict[str, Any]:
        """What a training goes on with."""
        state: dict[str, Any] = {"embedding": self.embedding.state_dict()}
        return state | ({"cloning": self.cloning.state_dict()} if self.goes_on else {})

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Restore :meth:`state_dict`."""
        self.embedding.load_state_dict(state["embedding"])
        if self.goes_on:
            self.cloning.load_state_dict(state["cloning"])

    def starts(self, count: int) -> torch.Tensor:
        """(count,) rows of the clips' states, drawn as demonstrations are."""
        return self.clips.rows(
            *self.motions.sample(count, generator=self._generator, margin=CONTROL_DT)
        )

    def cloned(self, count: int) -> torch.Tensor:
        """(count,) rows at which the windows to be cloned start: some at the beginning of a clip,
        the others anywhere.
        """
        clips, times = self.motions.sample(count, generator=self._generator, margin=CONTROL_DT)
        times[: round(self.config.bc_clip_start_fraction * count)] = 0.0
        return self.clips.rows(clips, times)
