"""What the loop asks of a trainer."""

from __future__ import annotations

from typing import Any, Protocol


class Stateful(Protocol):
    """Something that a checkpoint holds."""

    def state_dict(self) -> dict[str, Any]:
        """All that it goes on from."""

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Restore :meth:`state_dict`."""


class Trainer(Stateful, Protocol):
    """One training, an iteration at a time. Its state (networks, optimisers, environment,
    generators) must make the next iteration what it would have been.
    """

    samples_per_iteration: int

    def iterate(self, progress: float) -> dict[str, float]:
        """Collect a rollout and learn from it; ``progress`` in [0, 1) is the share of the training
        already done.
        """
