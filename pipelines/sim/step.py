"""What came of one control step."""

from __future__ import annotations

from dataclasses import dataclass

import torch


@dataclass(frozen=True)
class Step:
    """One control step of N worlds, before any reset.

    Attributes:
        frame: (N, 10 + 2J) clean style frame in which the step ended, before any push.
        reward: (N,) task reward, already times 0.02 s.
        fell: (N,) bool, the episode ended by a fall or a diverged world.
        timed_out: (N,) bool, the episode reached its length without falling.
        valid: (N,) bool, False where the physics diverged and the transition means nothing.
        violations: constraint name -> (N, k) signed margins c (positive: violated).
    """

    frame: torch.Tensor
    reward: torch.Tensor
    fell: torch.Tensor
    timed_out: torch.Tensor
    valid: torch.Tensor
    violations: dict[str, torch.Tensor]

    @property
    def done(self) -> torch.Tensor:
        """(N,) bool, worlds to reset."""
        return self.fell | self.timed_out
