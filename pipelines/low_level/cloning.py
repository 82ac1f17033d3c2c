"""Cloning of the clips, and of what experts say about states beside them."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import torch
from rsl_rl.models import MLPModel
from tensordict import TensorDict

from lacoloco.pipelines.learn.ase import LATENT, POLICY
from lacoloco.pipelines.learn.behaviour_cloning import CloningData, clone
from lacoloco.pipelines.learn.latents import project, scatter
from lacoloco.pipelines.learn.skill_embedding import SkillEmbedding
from lacoloco.pipelines.low_level.expert_labels import ExpertLabels
from lacoloco.pipelines.low_level.expert_worlds import LabelledStates
from lacoloco.pipelines.sim.clip_actions import ClipStates

ASKED_SHARE = 0.5
"""Share of a batch that is of states in which experts were asked, once there are any."""

HELD_NOISE = 8191
"""Windows that follow each other have a noise of their own, so many before it comes again."""


class Cloning:
    """The data of a low level's pretraining, which grows with every round of questions."""

    def __init__(
        self,
        clips: ClipStates,
        embedding: SkillEmbedding,
        data: CloningData,
        starts: Callable[[int], torch.Tensor],
        generator: torch.Generator,
        latent_noise: float = 0.0,
    ) -> None:
        """Begin with the clips alone.

        Args:
            clips: Their states.
            embedding: Gives windows of them their latents.
            data: What to reproduce.
            starts: ``starts(n)`` draws n rows at which windows begin.
            generator: Source of randomness.
            latent_noise: How far the policy's latents may lie from those of the windows, see
                :func:`~lacoloco.pipelines.learn.latents.scatter`. No clip has the latents in
                between, but a high level will choose them.
        """
        self._clips, self._embedding, self._data = clips, embedding, data
        self._starts, self._generator, self._latent_noise = starts, generator, latent_noise
        self._asked: LabelledStates | None = None
        self._joined: CloningData | None = None

    def fit(
        self, actor: MLPModel, steps: int, watch: Callable[[int, float], None] | None = None
    ) -> float:
        """Fit the actor's mean, and the embedding with it; see
        :func:`~lacoloco.pipelines.learn.behaviour_cloning.clone`.
        """
        return clone(
            actor,
            self._embedding,
            self._known(),
            self._sample,
            steps=steps,
            latent_noise=self._latent_noise,
            generator=self._generator,
            watch=watch,
        )

    def state_dict(self) -> dict[str, Any]:
        """What the next fit begins with, the actor excepted."""
        return {
            "asked": {} if self._asked is None else dict(vars(self._asked)),
            "embedding": self._embedding.state_dict(),
            "generator": self._generator.get_state(),
        }

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Restore :meth:`state_dict`."""
        device = self._data.frames.device
        asked = {name: values.to(device) for name, values in state["asked"].items()}
        self._asked = LabelledStates(**asked) if asked else None
        self._joined = None
        self._embedding.load_state_dict(state["embedding"])
        self._generator.set_state(state["generator"])

    def ask(
        self,
        actor: MLPModel,
        labels: ExpertLabels,
        noise: torch.Tensor,
        action_noise: float,
        watch: Callable[[int], None] | None = None,
    ) -> float:
        """Let the actor move by itself, with the noise of training, and keep what the experts say.

        Args:
            actor: The actor.
            labels: Worlds with experts.
            noise: (F + A,) half-ranges of the uniform noise on what it sees.
            action_noise: Standard deviation of the noise on its actions.
            watch: ``watch(1)`` is told every control step.

        Returns:
            Its falls per 1000 steps.
        """
        ahead, dim = self._embedding.config.ahead, self._embedding.dim
        # A window's latent is held, and its noise with it.
        apart = scatter(HELD_NOISE, dim, self._latent_noise, self._generator)

        @torch.no_grad()
        def student(observation: torch.Tensor, rows: torch.Tensor) -> torch.Tensor:
            if watch is not None:
                watch(1)
            # A latent is held while it stands for what the clip does, then the next one is taken.
            first = self._first(rows)
            windows = rows - (rows - first) % max(1, ahead)
            latents = self._embedding(windows)
            if self._latent_noise:
                latents = project(latents + apart[windows % HELD_NOISE])
            groups = {POLICY: self._data.view(observation), LATENT: latents}
            mean: torch.Tensor = actor(groups)
            return mean

        new, falls = labels.collect(student, noise, action_noise, self._data.history)
        self._asked = new if self._asked is None else LabelledStates.joined([self._asked, new])
        self._joined = None
        return falls

    def forget(self, kept: int) -> None:
        """Keep about ``kept`` of the experts' answers, or all; none where it is 0."""
        if self._asked is not None:
            history, generator = self._data.history, self._generator
            self._asked = self._asked.sampled(kept, history, generator) if kept else None
            self._joined = None

    @torch.no_grad()
    def answers(self, count: int) -> tuple[TensorDict, torch.Tensor]:
        """What the actor sees in ``count`` states of clips and of itself, and the actions (count,
        A) to reproduce there, NaN where nobody knows.
        """
        windows, rows = self._sample(count)
        latents = self._embedding(windows)
        if self._latent_noise:
            apart = scatter(count, self._embedding.dim, self._latent_noise, self._generator)
            latents = project(latents + apart)
        data = self._known()
        groups = {POLICY: data.observe(rows, self._generator), LATENT: latents}
        return TensorDict(groups, batch_size=[count]), data.actions[rows]

    def _known(self) -> CloningData:
        """The clips, and the states in which experts were asked."""
        if self._asked is None:
            return self._data
        if self._joined is None:
            asked = self._asked
            self._joined = self._data.extended(
                asked.frames, asked.previous, asked.actions, asked.before
            )
        return self._joined

    def _sample(self, count: int) -> tuple[torch.Tensor, torch.Tensor]:
        """(count,) rows at which windows begin, and rows of the data for their latents."""
        asked = 0 if self._asked is None else round(ASKED_SHARE * count)
        windows = self._starts(count - asked)
        rows = self._embedding.moments(windows, self._generator)
        if self._asked is None:
            return windows, rows
        chosen = self._integers(len(self._asked), asked)
        performed = self._asked.rows[chosen]
        back = self._integers(self._embedding.config.ahead + 1, asked)
        earlier = torch.maximum(performed - back, self._first(performed))
        offset = len(self._data.frames)
        return torch.cat((windows, earlier)), torch.cat((rows, offset + chosen))

    def _first(self, rows: torch.Tensor) -> torch.Tensor:
        """(n,) first row of the clip that each row belongs to."""
        number = torch.searchsorted(self._clips.first, rows, right=True) - 1
        return self._clips.first[number]

    def _integers(self, below: int, count: int) -> torch.Tensor:
        generator = self._generator
        return torch.randint(below, (count,), generator=generator, device=generator.device)


class CloningRounds:
    """The rounds of a pretraining: fit, ask the experts, fit again; and what a round goes on
    from.
    """

    def __init__(self, cloning: Cloning, actor: MLPModel, labels: ExpertLabels | None) -> None:
        """Begin; without ``labels`` nobody is asked."""
        self.cloning, self.actor, self.labels = cloning, actor, labels
        self.metrics: dict[str, float] = {}
        """What the rounds so far came to; with ``clone_error`` after the last one."""

    def ask(self, noise: torch.Tensor, action_noise: float, watch: Callable[[int], None]) -> float:
        """Ask the experts where the actor gets to; see :meth:`Cloning.ask`."""
        assert self.labels is not None
        falls = self.cloning.ask(self.actor, self.labels, noise, action_noise, watch=watch)
        self.metrics["expert_falls_per_1000_steps"] = falls
        return falls

    def state_dict(self) -> dict[str, Any]:
        """Actor, embedding, answers, the experts' worlds, generators."""
        return {
            "actor": self.actor.state_dict(),
            "cloning": self.cloning.state_dict(),
            "labels": self.labels.state_dict() if self.labels is not None else {},
            "metrics": dict(self.metrics),
        }

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Restore :meth:`state_dict`."""
        self.actor.load_state_dict(state["actor"])
        self.cloning.load_state_dict(state["cloning"])
        if self.labels is not None:
            self.labels.load_state_dict(state["labels"])
        self.metrics = dict(state["metrics"])
