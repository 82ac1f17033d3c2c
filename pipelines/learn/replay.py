"""A fixed-size memory of the policy's past transitions."""

from __future__ import annotations

import torch

STATE_BYTES = 8 << 20
"""At most so much of a memory goes into a checkpoint, which has to travel; 30 000 transitions of
Solo12.
"""


class ReplayBuffer:
    """Keeps ``capacity`` transitions (2F numbers each); once full, each newcomer overwrites a
    random slot.
    """

    def __init__(
        self, capacity: int, transition_dim: int, *, seed: int, device: torch.device | str = "cpu"
    ) -> None:
        """Allocate an empty memory."""
        self.data = torch.zeros(capacity, transition_dim, device=device)
        self.size, self.generator = 0, torch.Generator(device).manual_seed(seed)

    def add(self, transitions: torch.Tensor) -> None:
        """Store (n, 2F) transitions; n may not exceed the capacity."""
        free = len(self.data) - self.size
        head = min(free, len(transitions))
        self.data[self.size : self.size + head] = transitions[:head]
        self.size += head
        rest = transitions[head:]
        if len(rest):
            slots = torch.randperm(
                len(self.data), generator=self.generator, device=self.data.device
            )
            self.data[slots[: len(rest)]] = rest

    def sample(self, count: int) -> torch.Tensor:
        """(count, 2F) uniform with replacement; the memory must not be empty."""
        rows = torch.randint(
            0, self.size, (count,), generator=self.generator, device=self.data.device
        )
        return self.data[rows]

    def state_dict(self) -> dict[str, torch.Tensor]:
        """Contents and generator; of a large memory every second, third, ... transition, so a fair
        sample of it.
        """
        row_bytes = self.data.shape[1] * self.data.element_size()
        stride = max(1, -(-self.size * row_bytes // STATE_BYTES))
        return {"data": self.data[: self.size : stride], "generator": self.generator.get_state()}

    def load_state_dict(self, state: dict[str, torch.Tensor]) -> None:
        """Restore :meth:`state_dict`."""
        data = state["data"][: len(self.data)]
        self.size = len(data)
        self.data[: self.size] = data.to(self.data.device)
        self.generator.set_state(state["generator"])
