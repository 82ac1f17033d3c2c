"""Skill latents on the unit sphere (paper section III-A, "Latent Space")."""

from __future__ import annotations

from dataclasses import dataclass

import torch

from lacoloco.pipelines.masking import pick, put, select


def project(unnormalized: torch.Tensor) -> torch.Tensor:
    """(..., d) -> unit vectors along the last axis: z = u / |u|."""
    return torch.nn.functional.normalize(unnormalized, dim=-1, eps=1e-8)


def sample_latents(count: int, dim: int, draw: torch.Generator) -> torch.Tensor:
    """(count, dim) uniform on the unit sphere: a normalised standard Gaussian, on the generator's
    device.
    """
    return project(torch.randn(count, dim, generator=draw, device=draw.device))


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
    """How latents are drawn.

    Attributes:
        dim: dimension of z.
        min_steps: fewest control steps for which one is held.
        max_steps: most of them.
        wander: steps of the slowest and of the fastest wandering latent, the standard deviation of
            what is added to the unit vector. At 0.03 a skill lasts, at 1 the skills blur into
            something that is none of them: a high level does both.
        wander_steps: control steps between two such steps.
        jump: share of the steps that lead anywhere instead.
    """

    dim: int = 7
    min_steps: int = 1
    max_steps: int = 149
    wander: tuple[float, float] = (0.03, 1.0)
    wander_steps: int = 5
    jump: float = 0.05


class LatentSchedule:
    """The latent of every world: held for a random while, new at every reset; all uniform on the
    sphere.

    Those of the worlds that wander move on in steps, each world in its own, as under a high level
    that makes up its mind.
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
        self.config, self.draw, self.device = (
            config,
            torch.Generator(device).manual_seed(seed),
            device,
        )
        self.wandering = torch.zeros(num_worlds, dtype=torch.bool, device=device)
        """(N,) bool, which worlds wander; none until somebody says so."""
        # Multiples of the golden ratio: evenly spread over whichever worlds wander.
        place = torch.arange(num_worlds, device=device) * 0.6180339887498949 % 1.0
        slowest, fastest = config.wander
        self.stride = slowest * (fastest / slowest) ** place
        """(N,) how far a world's latent wanders at once."""
        self.z = sample_latents(num_worlds, config.dim, self.draw)
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
        return {"z": self.z, "remaining": self.remaining, "draw": self.draw.get_state()}

    def load_state_dict(self, state: dict[str, torch.Tensor]) -> None:
        """Restore :meth:`state_dict`."""
        self.z, self.remaining = state["z"].to(self.device), state["remaining"].to(self.device)
        self.draw.set_state(state["draw"])

    def _next(self, worlds: torch.Tensor, done: torch.Tensor) -> torch.Tensor:
        fresh = torch.randn(
            len(worlds), self.config.dim, generator=self.draw, device=self.draw.device
        )
        jumps = (
            torch.rand(len(worlds), generator=self.draw, device=self.draw.device) < self.config.jump
        )
        goes_on = pick(self.wandering & ~done, worlds) & ~jumps
        moved = pick(self.z, worlds) + pick(self.stride, worlds)[:, None] * fresh
        return project(torch.where(goes_on[:, None], moved, fresh))

    def _durations(self, worlds: torch.Tensor) -> torch.Tensor:
        low, high = self.config.min_steps, self.config.max_steps
        held = torch.randint(
            low, high + 1, (len(worlds),), generator=self.draw, device=self.draw.device
        )
        return torch.where(pick(self.wandering, worlds), self.config.wander_steps, held)
