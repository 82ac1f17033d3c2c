"""Behaviour cloning: fit an actor's mean to the actions of clips, given latents of what each clip
does.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import torch
from rsl_rl.models import MLPModel
from tensordict import TensorDict

from lacoloco.pipelines.learn.latents import project, scatter
from lacoloco.pipelines.learn.precision import fast_products
from lacoloco.pipelines.learn.skill_embedding import SkillEmbedding, uniformity

UNIFORMITY_WEIGHT = 0.02
"""Enough to reach the uniform distribution's own value within 1 % while the actions' error stays as
without it.
"""
PAIRS_FROM = 1024
"""Latents of a batch that are compared with each other."""

WATCHED_STEPS = 50
"""Gradient steps between two calls of a watcher: it waits for the device."""


@dataclass(frozen=True)
class CloningData:
    """What to reproduce, row by row of one timeline; further rows may follow.

    Attributes:
        frames: (M, F) clean style frames.
        previous: (M, A) actions before.
        actions: (M, A) actions to reproduce, NaN where nobody knows.
        noise: (F + A,) half-ranges of the uniform observation noise.
        action_noise: standard deviation added to ``previous``; more than exploration will add,
            because a policy that may trust its last action repeats it and never leaves a standing
            start.
        before: (M,) row one step earlier, a row itself where there is none; needed for a history.
        history: how many readings the policy sees, that of now included.
        columns: (P,) columns that it sees of them, one behind the other; None: all.
    """

    frames: torch.Tensor
    previous: torch.Tensor
    actions: torch.Tensor
    noise: torch.Tensor
    action_noise: float = 0.12
    before: torch.Tensor | None = None
    history: int = 1
    columns: torch.Tensor | None = None

    def extended(
        self,
        frames: torch.Tensor,
        previous: torch.Tensor,
        actions: torch.Tensor,
        before: torch.Tensor,
    ) -> CloningData:
        """The same with further rows after it; ``before`` counts from the first of those."""
        joined = self.before
        if joined is not None:
            joined = torch.cat((joined, len(self.frames) + before))
        return replace(
            self,
            before=joined,
            frames=torch.cat((self.frames, frames)),
            previous=torch.cat((self.previous, previous)),
            actions=torch.cat((self.actions, actions)),
        )

    def observe(self, rows: torch.Tensor, generator: torch.Generator) -> torch.Tensor:
        """(n, P) noisy observations: the fitted policy must forgive what it will meet."""
        readings = [self._reading(rows, generator)]
        for _ in range(1, self.history):
            assert self.before is not None
            rows = self.before[rows]
            readings.append(self._reading(rows, generator))
        return self.view(torch.cat(readings, dim=-1))

    def view(self, readings: torch.Tensor) -> torch.Tensor:
        """(n, P) what the policy sees of ``history`` readings (n, history (F + A)), newest
        first.
        """
        return readings if self.columns is None else readings[:, self.columns]

    def _reading(self, rows: torch.Tensor, generator: torch.Generator) -> torch.Tensor:
        last = self.previous[rows]
        last = last + self.action_noise * torch.randn(
            last.shape, generator=generator, device=generator.device
        )
        clean = torch.cat((self.frames[rows], last), dim=-1)
        spread = 2.0 * torch.rand(clean.shape, generator=generator, device=generator.device) - 1.0
        return clean + spread * self.noise


def clone(
    actor: MLPModel,
    embedding: SkillEmbedding,
    data: CloningData,
    sample: Callable[[int], tuple[torch.Tensor, torch.Tensor]],
    *,
    steps: int,
    batch: int = 2048,
    learning_rate: float = 1e-3,
    latent_noise: float = 0.0,
    generator: torch.Generator,
    watch: Callable[[int, float], None] | None = None,
) -> float:
    """Minimise the squared error of the mean action over actor and embedding together; latents stay
    uniform.

    Layers multiply in bfloat16 where :func:`~lacoloco.pipelines.learn.precision.fast_products` says
    that this is faster; losses and updates are float32.

    Args:
        actor: over the groups ``policy`` (frame, last action) and ``latent``; its normaliser learns
            the observations.
        embedding: gives the latents; learns with the actor.
        data: what to reproduce.
        sample: ``sample(n)`` draws n rows at which windows of the timeline begin, and n rows of the
            data that their latents stand for.
        steps: gradient steps.
        batch: rows per step.
        learning_rate: Adam's, falling linearly to zero.
        latent_noise: how far the actor's latents may lie from the embedding's; see
            :func:`~lacoloco.pipelines.learn.latents.scatter`.
        generator: source of randomness, on the device of the data's tensors.
        watch: ``watch(n, error)`` is told, every so often, that n further steps are done, and their
            root mean squared error.

    Returns:
        Root mean squared error over the last tenth of the steps, in action units.
    """

    def observe(count: int) -> tuple[TensorDict, torch.Tensor, torch.Tensor]:
        windows, rows = sample(count)
        with fast_products(windows.device):
            raw = embedding.points(windows)
        exact = latents = project(raw.float())
        if latent_noise:
            latents = project(exact + scatter(len(exact), exact.shape[1], latent_noise, generator))
        groups = {"policy": data.observe(rows, generator), "latent": latents}
        return TensorDict(groups, batch_size=[len(rows)]), exact, rows

    with torch.no_grad():
        actor.update_normalization(observe(4 * batch)[0])
    optimizer = torch.optim.Adam(
        [*actor.mlp.parameters(), *embedding.parameters()], lr=learning_rate, fused=True
    )
    errors = []
    for step in range(steps):
        optimizer.param_groups[0]["lr"] = learning_rate * (1.0 - step / steps)
        observations, exact, rows = observe(batch)
        # Nothing is asked where nobody knows.
        with fast_products(rows.device):
            means = actor(observations).float()
        error = (means - data.actions[rows]).nan_to_num().square().mean()
        loss = error + UNIFORMITY_WEIGHT * uniformity(exact[:PAIRS_FROM])
        optimizer.zero_grad(set_to_none=True)
        loss.backward()
        optimizer.step()
        errors.append(error.detach())
        told = step % WATCHED_STEPS + 1
        if watch is not None and (told == WATCHED_STEPS or step + 1 == steps):
            watch(told, _rms(errors[-told:]))
    return _rms(errors[-max(1, steps // 10) :])


def _rms(squares: list[torch.Tensor]) -> float:
    return float(torch.stack(squares).mean().sqrt())
