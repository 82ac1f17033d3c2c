"""What a task can name: a function over an environment, and the commands that it reads."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import torch


@dataclass(frozen=True)
class Registered:
    """A reward term or a constraint under its name.

    Attributes:
        function: Environment after a step, and parameters -> (N,) reward or (N, k) margins.
        commands: Types of command that it can read, keys of ``COMMANDS``; empty if it reads none.
        gait: Whether it reads the gait of a task that has one.
    """

    function: Callable[..., torch.Tensor]
    commands: tuple[str, ...] = ()
    gait: bool = False
