"""Generalised advantage estimation with soft terminations (paper eq. of CaT; Schulman et al.
2016).
"""

from __future__ import annotations

import torch


def advantages(
    rewards: torch.Tensor,
    values: torch.Tensor,
    next_values: torch.Tensor,
    delta: torch.Tensor,
    done: torch.Tensor,
    *,
    gamma: float,
    lam: float,
) -> torch.Tensor:
    """GAE over (T, N) tensors.

    A constraint's termination probability ``delta`` discounts everything that follows, value and
    trace alike, by gamma (1 - delta): the reward of step t itself must already have lost its own
    share (:func:`~lacoloco.pipelines.learn.cat.terminated`). A reset (``done``) only cuts the
    trace; whether there is a future is in ``next_values``: the true next state's value, also at a
    time-out (so it bootstraps), and zero after a fall.

    Args:
        rewards: what their own delta_t left of them.
        values: V(s_t).
        next_values: V(s_{t+1}) *before* any reset; 0 after a fall.
        delta: termination probabilities in [0, 1].
        done: bool, an episode ended at step t.
        gamma: discount per step.
        lam: GAE trace decay.

    Returns:
        (T, N) advantages; returns are advantages + values.
    """
    survive = gamma * (1.0 - delta)
    errors = rewards + survive * next_values - values
    trace = survive * lam * (~done)
    result = torch.empty_like(rewards)
    running = torch.zeros_like(rewards[0])
    for step in range(len(rewards) - 1, -1, -1):
        running = errors[step] + trace[step] * running
        result[step] = running
    return result
