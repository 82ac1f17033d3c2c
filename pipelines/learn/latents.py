"""Skill latents on the unit sphere (paper section III-A, "Latent Space")."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import torch

from lacoloco.datasets.config_values import Rising, Share, Within
from lacoloco.pipelines.masking import pick, put, select


def project(unnormalized: torch.Tensor) -> torch.Tensor:
    """(..., d) -> unit vectors along the last axis: z = u / |u|."""
    return torch.nn.functional.normalize(unnormalized, dim=-1, eps=1e-8)


def sample_latents(count: int, dim: int, generator: torch.Generator) -> torch.Tensor:
    """(count, dim) uniform on the unit sphere: a normalised standard Gaussian, on the generator's
    device.
    """
    return project(torch.randn(count, dim, generator=generator, device=generator.device))


def scatter(count: int, dim: int, spread: float, generator: torch.Generator) -> torch.Tensor:
    """(count, dim) Gaussian noise for latents, before they are projected again.

    Its standard deviation is uniform between 0 and ``spread``, another for every latent: some stay
    where they are, others come to lie where no clip has its latent.
    """
    device = generator.device
    std = spread * torch.rand(count, 1, generator=generator, device=device)
    return std * torch.randn(count, dim, generator=generator, device=device)


def latent_usage(chosen: torch.Tensor) -> dict[str, float]:
    """How much of the sphere the chosen latents (n, d), unit vectors, make use of.

    Returns:
        ``latent_resultant``: length of their mean, 1 when always the same is chosen, near 0 when
            they cancel out;
        ``latent_directions``: exp of the entropy of the eigenvalues of E[z z'], from 1 (one line)
            to d (all alike).
    """
    moment = chosen.double().T @ chosen.double() / len(chosen)
    weights = torch.linalg.eigvalsh(moment).clamp_min(1e-12)
    weights = weights / weights.sum()
    entropy = -(weights * weights.log()).sum()
    return {
        "latent_resultant": float(chosen.mean(dim=0).norm()),
        "latent_directions": float(entropy.exp()),
    }


@dataclass(frozen=True)
class LatentConfig:
    """How latents are sampled.

    Attributes:
        dim: Dimension of a latent.
        min_steps: Shortest time for which a latent is held [control steps].
        max_steps: Longest time for which a latent is held [control steps].
        random_walk_step_size: Step sizes of the slowest and of the fastest latent random walk: the
            standard deviation of what is added to the unit vector. At 0.03 a skill lasts, at 1
            skills blend. A high level does both.
        random_walk_steps: Time between two steps of a random walk [control steps].
        resample_probability: Share of the steps of a random walk that draw a new latent instead.
    """

    dim: Annotated[int, Within(2, 1024)] = 7
    min_steps: Annotated[int, Within(1, 10**6)] = 1
    max_steps: Annotated[int, Within(1, 10**6)] = 149
    random_walk_step_size: Annotated[tuple[float, float], Within(0, 1000, above=True), Rising()] = (
        0.03,
        1.0,
    )
    random_walk_steps: Annotated[int, Within(1, 10**6)] = 5
    resample_probability: Share = 0.05

    def conflict(self) -> str:
        """What does not fit together, "" if all does."""
        if self.min_steps <= self.max_steps:
            return ""
        return f"min_steps={self.min_steps}: use at most max_steps = {self.max_steps}"


class LatentSchedule:
    """The latent of every world: held for a random while, new at every reset; all uniform on the
    sphere.

    In some worlds it follows a random walk instead, as under a high level that changes its latent
    little by little. Each of these worlds has a step size of its own.
    """

    def __init__(
        self,
        num_worlds: int,
        config: LatentConfig,
        *,
        seed: int,
        device: torch.device | str = "cpu",
    ) -> None:
        """Draw a latent (N, dim) and its duration for every world."""
        self.config, self.generator, self.device = (
            config,
            torch.Generator(device).manual_seed(seed),
            device,
        )
        self.random_walk = torch.zeros(num_worlds, dtype=torch.bool, device=device)
        """(N,) bool, whose latent follows a random walk; none until it is set."""
        # Multiples of the golden ratio: evenly spread over any subset of the worlds.
        place = torch.arange(num_worlds, device=device) * 0.6180339887498949 % 1.0
        slowest, fastest = config.random_walk_step_size
        self.step_size = slowest * (fastest / slowest) ** place
        """(N,) step size of the random walk."""
        self.z = sample_latents(num_worlds, config.dim, self.generator)
        self.remaining = self._durations(torch.arange(num_worlds, device=device))

    def advance(self, done: torch.Tensor) -> None:
        """One control step has passed; worlds in ``done`` (N,) bool have just been reset."""
        self.remaining -= 1
        worlds = select(done | (self.remaining <= 0))
        if len(worlds):
            # A new tensor: the old latents may still be referenced by the transition being
            # recorded.
            self.z = self.z.clone()
            put(self.z, worlds, self._next(worlds, done))
            put(self.remaining, worlds, self._durations(worlds))

    def state_dict(self) -> dict[str, torch.Tensor]:
        """Latents, remaining steps, generator."""
        return {"z": self.z, "remaining": self.remaining, "generator": self.generator.get_state()}

    def load_state_dict(self, state: dict[str, torch.Tensor]) -> None:
        """Restore :meth:`state_dict`."""
        self.z, self.remaining = state["z"].to(self.device), state["remaining"].to(self.device)
        self.generator.set_state(state["generator"])

    def _next(self, worlds: torch.Tensor, done: torch.Tensor) -> torch.Tensor:
        fresh = torch.randn(
            len(worlds), self.config.dim, generator=self.generator, device=self.generator.device
        )
        resampled = (
            torch.rand(len(worlds), generator=self.generator, device=self.generator.device)
            < self.config.resample_probability
        )
        goes_on = pick(self.random_walk & ~done, worlds) & ~resampled
        moved = pick(self.z, worlds) + pick(self.step_size, worlds)[:, None] * fresh
        return project(torch.where(goes_on[:, None], moved, fresh))

    def _durations(self, worlds: torch.Tensor) -> torch.Tensor:
        low, high = self.config.min_steps, self.config.max_steps
        held = torch.randint(
            low, high + 1, (len(worlds),), generator=self.generator, device=self.generator.device
        )
        return torch.where(pick(self.random_walk, worlds), self.config.random_walk_steps, held)
