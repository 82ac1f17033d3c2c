"""Episode restarts: a world whose robot fell restarts from a snapshot of up to a second before, and
a world whose episode failed without a fall replays it from its start.

Falls are rare and come a second after their cause. A new episode may need thousands of steps to
come to the same situation; a restarted one is there at once, with other noise. The same holds for
targets that are never reached: they lie in narrow ranges of directions, which are seldom drawn.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import torch

from lacoloco.pipelines.masking import pick, put, select
from lacoloco.pipelines.sim.env import LeggedEnv

PERIOD, DEPTH = 10, 5
"""Control steps between two snapshots, and how many are kept: a world goes back by 0.8 to 1 s."""
RETURN, START = DEPTH, DEPTH + 1
"""The rows after the snapshots: the state that each world restarted from last, and the state in
which its episode started.
"""
STATE_BYTES = 2 << 20
"""Larger snapshots are not written into a checkpoint. A resumed training then starts without."""


class EpisodeRestarts:
    """Snapshots of all worlds, with the latents in force, and the restarts from them.

    A trainer calls :meth:`snapshot` before every step and :meth:`reset` after it.
    """

    def __init__(
        self,
        env: LeggedEnv,
        latent_dim: int,
        restart_probability: float,
        *,
        seed: int,
        hold: int = 1,
    ) -> None:
        """Start without snapshots.

        Args:
            env: The worlds.
            latent_dim: Dimension d of a latent.
            restart_probability: Share of falls and of failed episodes that are tried again, also
                after a restart.
            seed: Of the choice which ones.
            hold: Control steps between two calls of :meth:`snapshot`; divides ``PERIOD``.
        """
        self.env, self.restart_probability, self.period = env, restart_probability, PERIOD // hold
        self.generator = torch.Generator(env.device).manual_seed(seed)
        self._count = 0
        widths = {
            "qpos": 7 + env.spec.num_joints,
            "qvel": 6 + env.spec.num_joints,
            "action": env.num_actions,
            "command": 3,
            "latent": latent_dim,
        }
        self._kept = {
            name: torch.zeros(DEPTH + 2, env.num_worlds, width, device=env.device)
            for name, width in widths.items()
        }
        self.restarted = torch.zeros(env.num_worlds, dtype=torch.bool, device=env.device)
        """(N,) bool, worlds whose episode was restarted. Its outcome says nothing about whole
        episodes.
        """
        self._new = torch.zeros_like(self.restarted)
        self._start_known = torch.zeros_like(self.restarted)
        self._slot = torch.zeros(env.num_worlds, dtype=torch.long, device=env.device)
        self._numbers = torch.arange(env.num_worlds, device=env.device)

    def snapshot(self, latent: torch.Tensor) -> None:
        """Take a snapshot now and then; call before every step, with its latents (N, d)."""
        if self._count % self.period == 0:
            slot = self._count // self.period % DEPTH
            for name, value in self._now(latent).items():
                self._kept[name][slot] = value
        self._count += 1

    def reset(
        self,
        done: torch.Tensor,
        fell: torch.Tensor,
        failed: torch.Tensor | None = None,
        *,
        start: Callable[[torch.Tensor], torch.Tensor],
    ) -> torch.Tensor:
        """End the episodes of ``done``: restart some of them, start new ones in the other worlds.

        Args:
            done: (N,) bool, worlds whose episode ended.
            fell: (N,) bool, those of them in which the robot fell.
            failed: (N,) bool, those whose episode failed without a fall, to be replayed.
            start: ``start(done)`` starts new episodes in all of ``done`` and returns the latents
                (N, d) then in force.

        Returns:
            (N, d) latents in force, those of restarted worlds as they were.
        """
        chosen = self.select(fell, failed)
        latent = start(done)
        self._new = self._new | done & ~chosen
        return self.restore(chosen, latent)

    def redraw_new(self) -> None:
        """Give other physical parameters to all worlds with a new episode since the last call."""
        self.env.redraw(self._new)
        self._new = torch.zeros_like(self._new)

    def select(self, fell: torch.Tensor, failed: torch.Tensor | None = None) -> torch.Tensor:
        """(N,) bool, which worlds restart; called before the reset.

        Falls restart from the oldest snapshot. A world too young for it restarts only if it was
        restarted before, from the same state again. Failed episodes restart from their start, where
        it is known.
        """
        lucky = torch.rand(len(fell), generator=self.generator, device=fell.device)
        lucky = lucky < self.restart_probability
        if self._count < self.period * DEPTH:
            return torch.zeros_like(fell)
        old = self.env.steps > PERIOD * DEPTH
        # The slot that would be written next holds the oldest snapshot.
        oldest = -(-self._count // self.period) % DEPTH
        self._slot = torch.where(old, oldest, RETURN)
        chosen = fell & lucky & (old | self.restarted)
        if failed is None:
            return chosen
        self._slot = self._slot.masked_fill(failed, START)
        return chosen | failed & lucky & self._start_known

    def restore(self, chosen: torch.Tensor, latent: torch.Tensor) -> torch.Tensor:
        """Put the worlds ``chosen`` (N,) bool back, after the reset; returns the latents (N, d)."""
        self.restarted = self.restarted & (self.env.steps > 0) | chosen
        self._keep_starts((self.env.steps == 0) & ~chosen, latent)
        worlds = select(chosen)
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

    def state_dict(self) -> dict[str, Any]:
        """Snapshots, their count, generator."""
        small = sum(values.nbytes for values in self._kept.values()) <= STATE_BYTES
        flags = {"restarted": self.restarted, "start_known": self._start_known}
        kept = {**self._kept, **flags} if small else {}
        count = self._count if small else 0
        return {"count": count, "generator": self.generator.get_state(), **kept}

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Restore :meth:`state_dict`; without snapshots where it holds none."""
        self.generator.set_state(state["generator"])
        if "start_known" not in state:
            return
        self._count = int(state["count"])
        self._kept = {name: state[name].to(self.env.device) for name in self._kept}
        self.restarted, self._start_known = (
            state[name].to(self.env.device) for name in ("restarted", "start_known")
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

    def _keep_starts(self, mask: torch.Tensor, latent: torch.Tensor) -> None:
        worlds = select(mask)
        if not len(worlds):
            return
        self._start_known = self._start_known | mask
        for name, value in self._now(latent).items():
            put(self._kept[name][START], worlds, pick(value, worlds))
