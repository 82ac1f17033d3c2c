"""Sums of metrics over a rollout."""

from __future__ import annotations

import torch

from lacoloco.pipelines.learn import parallel


class MetricAccumulator:
    """Adds metrics up where they are computed, in double precision; reading them is the only wait
    for a GPU.
    """

    def __init__(self) -> None:
        """Start with nothing."""
        self._sums: dict[str, torch.Tensor] = {}

    def add(self, **metrics: torch.Tensor | None) -> None:
        """Add 0-d tensors by name; None adds nothing."""
        for name, value in metrics.items():
            if value is not None:
                old = self._sums.get(name)
                self._sums[name] = value.detach().double() if old is None else old + value.detach()

    def read(self) -> dict[str, float]:
        """All sums, in one transfer; their mean over the processes of a training, all of which must
        ask.
        """
        if not self._sums:
            return {}
        return dict(
            zip(
                self._sums,
                parallel.average(torch.stack(list(self._sums.values()))).tolist(),
                strict=True,
            )
        )
