"""Second chances: a robot that fell tries again from shortly before, in the same world.

Falls are rare and come a second after what caused them. Started anew, a world may take thousands of steps to come to the
same pass; put back, it is there again at once, with other noise.
"""

from __future__ import annotations

import torch

from lacoloco.pipelines.sim.env import LeggedEnv
from lacoloco.pipelines.worlds import pick, put, select

PERIOD, DEPTH = 10, 5
"""Control steps between two snapshots, and how many are kept: a world is put back by 0.8 to 1 s."""
STATE_BYTES = 1 << 20
"""Snapshots of more are not kept in a checkpoint, which has to travel: a resumed training then begins without any."""


class Retries:
    """Snapshots of all worlds, with the latents in force, and the way back to them."""

    def __init__(self, env: LeggedEnv, latent_dim: int, chance: float, *, seed: int) -> None:
        """Begin without any; a world that fell is put back with probability ``chance``."""
        self.env, self.chance = env, chance
        self.draw = torch.Generator(env.device).manual_seed(seed)
        self._count = 0
        widths = {"qpos": 7 + env.num_actions, "qvel": 6 + env.num_actions, "action": env.num_actions, "latent": latent_dim}
        self._kept = {
            name: torch.zeros(DEPTH, env.num_worlds, width, device=env.device) for name, width in widths.items()
        }

    def keep(self, latent: torch.Tensor) -> None:
        """Call before every control step, with the latents (N, d) that it will be taken under."""
        if self._count % PERIOD == 0:
            slot, physics = self._count // PERIOD % DEPTH, self.env.physics
            now = {"qpos": physics.qpos, "qvel": physics.qvel, "action": self.env.action, "latent": latent}
            for name, value in now.items():
                self._kept[name][slot] = value
        self._count += 1

    def choose(self, fell: torch.Tensor) -> torch.Tensor:
        """(N,) bool, those of the fallen worlds (N,) bool that are to try again: old enough, and lucky. Call before a reset."""
        lucky = torch.rand(len(fell), generator=self.draw, device=fell.device) < self.chance
        if self._count < PERIOD * DEPTH:
            return torch.zeros_like(fell)
        return fell & lucky & (self.env.steps > PERIOD * DEPTH)

    def put_back(self, mask: torch.Tensor, latent: torch.Tensor) -> torch.Tensor:
        """Undo the reset of the worlds in ``mask`` (N,) bool; returns the latents (N, d) with theirs as they were."""
        worlds = select(mask)
        if not len(worlds):
            return latent
        # The slot that would be written next holds the oldest snapshot.
        slot = -(-self._count // PERIOD) % DEPTH
        kept = {name: pick(values[slot], worlds) for name, values in self._kept.items()}
        self.env.start_from(worlds, kept["qpos"], kept["qvel"], kept["action"])
        latent = latent.clone()
        put(latent, worlds, kept["latent"])
        return latent

    def state_dict(self) -> dict[str, object]:
        """Snapshots, their count, generator."""
        small = sum(values.nbytes for values in self._kept.values()) <= STATE_BYTES
        kept = self._kept if small else {}
        return {"count": self._count if small else 0, "draw": self.draw.get_state(), **kept}

    def load_state_dict(self, state: dict[str, object]) -> None:
        """Restore :meth:`state_dict`."""
        self._count = int(state["count"])
        self.draw.set_state(state["draw"])
        for name in self._kept.keys() & state.keys():
            self._kept[name] = state[name].to(self.env.device)
