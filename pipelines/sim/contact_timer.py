"""Contact timing of the feet."""

from __future__ import annotations

import torch

from lacoloco.pipelines.masking import put
from lacoloco.pipelines.sim.physics import CONTROL_DT

CONTACT_FORCE = 1.0
"""Newtons above which a foot counts as touching (the original's code)."""


class FootTimer:
    """Which feet touch, which just touched down, and how long each was in the air before; all (N,
    F).
    """

    def __init__(self, num_worlds: int, feet: int, device: torch.device) -> None:
        """Start with every foot on the ground."""
        self.contact = torch.ones(num_worlds, feet, dtype=torch.bool, device=device)
        self.touch_down = torch.zeros_like(self.contact)
        self.air_time = torch.zeros(num_worlds, feet, device=device)
        self.last_air_time = torch.zeros_like(self.air_time)

    def update(self, force: torch.Tensor) -> None:
        """Advance by one control step, given the norm of the contact force on each foot (N, F)
        [N].
        """
        contact = force > CONTACT_FORCE
        self.touch_down = contact & ~self.contact
        self.last_air_time = torch.where(self.touch_down, self.air_time, self.last_air_time)
        self.air_time = torch.where(contact, 0.0, self.air_time + CONTROL_DT)
        self.contact = contact

    def reset(self, worlds: torch.Tensor) -> None:
        """Forget the past of ``worlds``, numbers (K,) or a mask (N,)."""
        put(self.contact, worlds, True)
        for timing in (self.touch_down, self.air_time, self.last_air_time):
            put(timing, worlds, 0)

    def state_dict(self) -> dict[str, torch.Tensor]:
        """The four (N, F) tensors."""
        return {key: getattr(self, key) for key in _KEYS}

    def load_state_dict(self, state: dict[str, torch.Tensor]) -> None:
        """Restore :meth:`state_dict`."""
        for key in _KEYS:
            setattr(self, key, state[key].to(self.contact.device))


_KEYS = ("contact", "touch_down", "air_time", "last_air_time")
