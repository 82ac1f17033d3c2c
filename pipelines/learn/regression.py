"""A small network fitted to pairs."""

from __future__ import annotations

from collections.abc import Callable

import torch
from rsl_rl.modules import MLP

HIDDEN, STEPS, BATCH = [128, 128], 2000, 1024


def fit_regression(
    inputs: torch.Tensor, outputs: torch.Tensor, generator: torch.Generator
) -> Callable[[torch.Tensor], torch.Tensor]:
    """A function (N, I) -> (N, O) with the least squared error on rows of ``inputs`` (M, I) and
    ``outputs`` (M, O).
    """
    mean, std = inputs.mean(dim=0), inputs.std(dim=0).clamp_min(1e-3)
    network = MLP(inputs.shape[1], outputs.shape[1], HIDDEN, "elu").to(inputs.device)
    optimizer = torch.optim.Adam(network.parameters(), lr=1e-3)
    for step in range(STEPS):
        optimizer.param_groups[0]["lr"] = 1e-3 * (1.0 - step / STEPS)
        rows = torch.randint(len(inputs), (BATCH,), generator=generator, device=inputs.device)
        loss = (network((inputs[rows] - mean) / std) - outputs[rows]).square().mean()
        optimizer.zero_grad(set_to_none=True)
        loss.backward()
        optimizer.step()

    @torch.no_grad()
    def predict(rows: torch.Tensor) -> torch.Tensor:
        answer: torch.Tensor = network((rows - mean) / std)
        return answer

    return predict
