"""Constraints as Terminations: violations become probabilities of losing all future reward (paper
section III-B).
"""

from __future__ import annotations

from typing import Literal

import torch

from lacoloco.pipelines.learn import parallel

Scale = Literal["mean", "maximum"]
"""What a violation is compared with: the typical one, or the largest of a batch."""


class SoftTerminations:
    """delta = max_i p_i clip(c_i+ / c_i^max, 0, 1), with c_i^max a running scale per constraint
    column.

    ``c_max`` follows the *mean violation* of the worlds that violate, by an exponential mean (rate
    0.05, the original's) and only on steps with a violation. In the paper it is the maximum of the
    batch. Among hundreds of worlds that is always the one that is just falling, beside which no
    step of a gait costs anything; and the original lets it decay to nothing while all is well, so
    that the next graze counts as the worst case.
    """

    def __init__(self, max_p: dict[str, float], rate: float = 0.05) -> None:
        """Take the largest probability of every constraint by name."""
        self.max_p, self.rate = dict(max_p), rate
        self.c_max: dict[str, torch.Tensor] = {}
        self.violated: dict[str, torch.Tensor] = {}

    def __call__(self, violations: dict[str, torch.Tensor], strength: float) -> torch.Tensor:
        """(N,) termination probabilities of one step.

        Args:
            violations: name -> (N, k) signed margins c, positive when violated.
            strength: factor in [0, 1] on every max_p, the place in the ramp.

        Returns:
            delta (N,) in [0, 1]; zeros when there are no constraints is the caller's case.
        """
        deltas = []
        for name, margin in violations.items():
            positive = margin.clamp_min(0.0)
            self.violated[name] = (margin > 0.0).float().mean()
            share = (positive / self._track(name, positive)).clamp(0.0, 1.0)
            deltas.append(share.amax(dim=-1) * (self.max_p[name] * strength))
        return torch.stack(deltas).amax(dim=0)

    def _track(self, name: str, positive: torch.Tensor) -> torch.Tensor:
        total, count = parallel.average(
            torch.stack((positive.sum(dim=0), (positive > 0.0).float().sum(dim=0)))
        )
        typical = total / count.clamp_min(1e-6)
        if name not in self.c_max:
            self.c_max[name] = typical.clamp_min(1e-6)
        old = self.c_max[name]
        self.c_max[name] = torch.where(
            count > 0.0, torch.lerp(old, typical, self.rate), old
        ).clamp_min(1e-6)
        return self.c_max[name]

    def end_batch(self) -> None:
        """A rollout has been recorded; here the scale follows every step."""

    def state_dict(self) -> dict[str, torch.Tensor]:
        """``c_max`` by constraint name."""
        return dict(self.c_max)

    def load_state_dict(self, state: dict[str, torch.Tensor]) -> None:
        """Restore :meth:`state_dict`."""
        self.c_max = dict(state)


class BatchMaximum(SoftTerminations):
    """The paper's text: c_max is the largest violation of the last batch of experience.

    In the first batch it is the largest so far. State is complete between batches only.
    """

    def __init__(self, max_p: dict[str, float]) -> None:
        """Begin without a batch."""
        super().__init__(max_p)
        self._largest: dict[str, torch.Tensor] = {}

    def end_batch(self) -> None:
        """What was largest in this rollout is the scale of the next one."""
        self.c_max = {
            name: parallel.maximum(largest).clamp_min(1e-6)
            for name, largest in self._largest.items()
        }
        self._largest = {}

    def _track(self, name: str, positive: torch.Tensor) -> torch.Tensor:
        now = positive.amax(dim=0)
        self._largest[name] = torch.maximum(now, self._largest.get(name, now))
        return self.c_max.get(name, self._largest[name]).clamp_min(1e-6)


def soft_terminations(max_p: dict[str, float], scale: Scale) -> SoftTerminations:
    """Those of a scale."""
    return SoftTerminations(max_p) if scale == "mean" else BatchMaximum(max_p)


def terminated(reward: torch.Tensor, delta: torch.Tensor) -> torch.Tensor:
    """What a termination with probability ``delta`` leaves of a reward: (1 - delta) of it where it
    is positive, all of it where it is negative.

    CaT is made for rewards that are never negative (Chane-Sane et al., 2024); of a penalty its
    factor (1 - delta) would take a part away, so that a violation paid. The original's code pays
    max(0, (1 - delta) r) instead, which makes most penalties of its reaching expert inert. What
    follows must be worth something for a termination to cost it; the weights of a task see to that.
    """
    return torch.where(reward > 0.0, reward * (1.0 - delta), reward)


def ramp(progress: float, start: float, end: float) -> float:
    """Strength of the constraints: 0 until ``start``, then linear to 1 at ``end``; all as shares of
    the training.
    """
    if progress >= end:
        return 1.0
    return max(0.0, (progress - start) / max(end - start, 1e-9))
