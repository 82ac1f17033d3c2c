"""Exploration noise per world: none, the usual one, or a larger one, each held for a while."""

from __future__ import annotations

import torch

MEAN, SAMPLED, HIGH_NOISE = 0.0, 1.0, 2.0


class Exploration:
    """The noise scale of each world: 0 (the mean action), 1, or ``high_noise_scale``.

    A world keeps its scale for a random time, then it is drawn again.

    Args:
        num_worlds: N.
        greedy_fraction: Mean share of steps on the mean; each world has a fixed probability of
            its own.
        noise_hold_steps: Mean number of steps for which a scale is held.
        high_noise_fraction: Share of the sampling times that have the high noise scale.
    """

    def __init__(
        self,
        num_worlds: int,
        greedy_fraction: float,
        noise_hold_steps: float,
        high_noise_fraction: float,
        device: torch.device | str,
    ) -> None:
        """Begin with the usual noise in every world."""
        self.probability = sampling_probability(num_worlds, greedy_fraction).to(device)
        self.noise_hold_steps, self.high_noise_fraction = noise_hold_steps, high_noise_fraction
        self.kind = torch.full((num_worlds,), SAMPLED, device=device)
        """(N,) ``MEAN``, ``SAMPLED`` or ``HIGH_NOISE``."""
        self.high_noise_scale = 1.0
        """Factor on the exploration std where the noise is high."""

    def advance(self) -> torch.Tensor:
        """(N,) factors on the exploration std for the next step, 0 where it is to be the mean."""
        sample, high, change = torch.rand(3, len(self.kind), device=self.kind.device)
        drawn = torch.where(high < self.high_noise_fraction, HIGH_NOISE, SAMPLED)
        drawn = torch.where(sample < self.probability, drawn, MEAN)
        self.kind = torch.where(change * self.noise_hold_steps < 1.0, drawn, self.kind)
        return torch.where(self.kind == HIGH_NOISE, self.high_noise_scale, self.kind)


def sampling_probability(num_worlds: int, share: float) -> torch.Tensor:
    """(N,) probability that a world samples its action: 1 - exp(k (i/(N-1) - 1)), k such that the
    mean is 1 - ``share``.

    The original fixes k = 10, a mean greedy fraction of 0.1; 0 turns it off.
    """
    if share <= 0.0:
        return torch.ones(num_worlds)
    place = torch.linspace(0.0, 1.0, num_worlds)
    return 1.0 - torch.exp((place - 1.0) / share)
