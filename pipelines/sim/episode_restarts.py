"""Second chances: a robot that fell tries again from shortly before, in the same world; one that
missed, from the start.

Falls are rare and come a second after what caused them. Started anew, a world may take thousands of
steps to come to the same pass; put back, it is there again at once, with other noise. So it is with
targets that are never reached from where the robot stands: they lie in narrow ranges of directions,
which chance seldom draws.
"""

from __future__ import annotations

import torch

from lacoloco.pipelines.masking import pick, put, select
from lacoloco.pipelines.sim.env import LeggedEnv

PERIOD, DEPTH = 10, 5
"""Control steps between two snapshots, and how many are kept: a world is put back by 0.8 to 1 s."""
RETURN, START = DEPTH, DEPTH + 1
"""The rows after the snapshots: where each world was put back to last, and where its episode
began.
"""
STATE_BYTES = 2 << 20
"""Snapshots of more are not kept in a checkpoint, which has to travel: a resumed training then
begins without any.
"""


class EpisodeRestarts:
    """Snapshots of all worlds, with the latents in force, and the way back to them."""

    def __init__(
        self, env: LeggedEnv, latent_dim: int, chance: float, *, seed: int, hold: int = 1
    ) -> None:
        """Begin without any; a world that fell is put back with probability ``chance``, and again
        when it falls again.

        Args:
            env: the worlds.
            latent_dim: d.
            chance: of a fall being undone.
            seed: of whom luck favours.
            hold: control steps from one call of :meth:`snapshot` to the next; divides ``PERIOD``.
        """
        self.env, self.chance, self.period = env, chance, PERIOD // hold
        self.generator = torch.Generator(env.device).manual_seed(seed)
        self._count = 0
        widths = {
            "qpos": 7 + env.num_actions,
            "qvel": 6 + env.num_actions,
            "action": env.num_actions,
            "command": 3,
            "latent": latent_dim,
        }
        self._kept = {
            name: torch.zeros(DEPTH + 2, env.num_worlds, width, device=env.device)
            for name, width in widths.items()
        }
        self.returned = torch.zeros(env.num_worlds, dtype=torch.bool, device=env.device)
        """(N,) bool, worlds that live a second time: what becomes of them says nothing about whole
        episodes.
        """
        self._begun = torch.zeros_like(self.returned)
        self._slot = torch.zeros(env.num_worlds, dtype=torch.long, device=env.device)
        self._numbers = torch.arange(env.num_worlds, device=env.device)

    def snapshot(self, latent: torch.Tensor) -> None:
        """Call before every step, with the latents (N, d) that it will be taken under."""
        if self._count % self.period == 0:
            slot = self._count // self.period % DEPTH
            for name, value in self._now(latent).items():
                self._kept[name][slot] = value
        self._count += 1

    def select(self, fell: torch.Tensor, missed: torch.Tensor | None = None) -> torch.Tensor:
        """(N,) bool, those of the fallen worlds (N,) bool and of those that missed that are to try
        again. Call before a reset.

        Lucky ones, and old enough, or put back before and fallen again: those go back to where they
        went back to. Whoever missed goes back to where its episode began.
        """
        lucky = torch.rand(len(fell), generator=self.generator, device=fell.device) < self.chance
        if self._count < self.period * DEPTH:
            return torch.zeros_like(fell)
        old = self.env.steps > PERIOD * DEPTH
        # The slot that would be written next holds the oldest snapshot.
        oldest = -(-self._count // self.period) % DEPTH
        self._slot = torch.where(old, oldest, RETURN)
        again = fell & lucky & (old | self.returned)
        if missed is None:
            return again
        self._slot = self._slot.masked_fill(missed, START)
        return again | missed & lucky & self._begun

    def restore(self, mask: torch.Tensor, latent: torch.Tensor) -> torch.Tensor:
        """Undo the reset of the worlds in ``mask`` (N,) bool; returns the latents (N, d) with
        theirs as they were.
        """
        self.returned = self.returned & (self.env.steps > 0) | mask
        self._begin((self.env.steps == 0) & ~mask, latent)
        worlds = select(mask)
        if not len(worlds):
            return latent
        where = pick(self._slot, worlds), pick(self._numbers, worlds)
        kept = {name: values[where] for name, values in self._kept.items()}
        for name, values in self._kept.items():
            put(values[RETURN], worlds, kept[name])
        self.env.start_from(worlds, kept["qpos"], kept["qvel"], kept["action"])
        put(self.env.command, worlds, kept["command"])
        latent = latent.clone()
        put(latent, worlds, kept["latent"])
        return latent

    def state_dict(self) -> dict[str, object]:
        """Snapshots, their count, generator."""
        small = sum(values.nbytes for values in self._kept.values()) <= STATE_BYTES
        kept = {**self._kept, "returned": self.returned, "begun": self._begun} if small else {}
        return {
            "count": self._count if small else 0,
            "generator": self.generator.get_state(),
            **kept,
        }

    def load_state_dict(self, state: dict[str, object]) -> None:
        """Restore :meth:`state_dict`; without snapshots if it holds none, or those of a version
        that kept no beginnings.
        """
        self.generator.set_state(state["generator"])
        if "begun" not in state:
            return
        self._count = int(state["count"])
        self._kept = {name: state[name].to(self.env.device) for name in self._kept}
        self.returned, self._begun = (
            state[name].to(self.env.device) for name in ("returned", "begun")
        )

    def _now(self, latent: torch.Tensor) -> dict[str, torch.Tensor]:
        env = self.env
        return {
            "qpos": env.physics.qpos,
            "qvel": env.physics.qvel,
            "action": env.action,
            "command": env.command,
            "latent": latent,
        }

    def _begin(self, mask: torch.Tensor, latent: torch.Tensor) -> None:
        worlds = select(mask)
        if not len(worlds):
            return
        self._begun = self._begun | mask
        for name, value in self._now(latent).items():
            put(self._kept[name][START], worlds, pick(value, worlds))
