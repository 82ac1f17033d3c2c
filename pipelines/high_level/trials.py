"""Latents held for a while in every world, and what came of them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, fields

import torch

from lacoloco.datasets.rotations import from_yaw, rotate, rotate_inverse, yaw
from lacoloco.pipelines.high_level.config import SkillDynamicsConfig
from lacoloco.pipelines.learn.latents import project, sample_latents, scatter
from lacoloco.pipelines.masking import put, select
from lacoloco.pipelines.sim.hierarchical_env import LatentSteeredEnv

OFFSETS = (3, 6, 10, 16)
"""How many decisions ahead to look. An end effector may need more than a second to be raised; what
is known only later than that depends on more than a latent.
"""


@dataclass(frozen=True)
class Trials:
    """M decisions under a latent that was held, each with what came of it at K ``OFFSETS``.

    Attributes:
        obs: (M, H) high-level observations.
        latent: (M, d) unit latents.
        root_pos: (M, 3) world [m].
        root_quat: (M, 4) wxyz.
        reached: (M, K, 3) where the end effector was, in the base frame of the decision [m].
        standing: (M, K) bool, whether the latent was still held then and the robot on its feet.
        fell: (M, K) bool, whether it had fallen by then.
    """

    obs: torch.Tensor
    latent: torch.Tensor
    root_pos: torch.Tensor
    root_quat: torch.Tensor
    reached: torch.Tensor
    standing: torch.Tensor
    fell: torch.Tensor

    def joined(self, other: Trials) -> Trials:
        """Both, one after the other."""
        pairs = ((getattr(self, row.name), getattr(other, row.name)) for row in fields(self))
        return Trials(*(torch.cat(pair) for pair in pairs))

    def ahead(self, rows: torch.Tensor) -> torch.Tensor:
        """(n, 2) how far ahead and to the left of the base the end effector came, by the heading
        and at the last offset with an answer [m].
        """
        last = self.standing[rows].sum(dim=1) - 1
        quat = self.root_quat[rows]
        moved = rotate(quat, self.reached[rows, last])
        ahead: torch.Tensor = rotate_inverse(from_yaw(yaw(quat)), moved)
        return ahead[:, :2]


def try_latents(
    env: LatentSteeredEnv,
    config: SkillDynamicsConfig,
    generator: torch.Generator,
    policy: Callable[[torch.Tensor], torch.Tensor] | None = None,
    watch: Callable[[int], None] | None = None,
) -> Trials:
    """Hold latents that are drawn at random, and remember what came of them.

    Args:
        env: The worlds.
        config: How many decisions, and for how long a latent is held.
        generator: Source of randomness.
        policy: Observations (N, H) to unit latents (N, d). With it, half of the time it steers, so
            that latents are tried where it brings the robot, and some are drawn near its own.
        watch: ``watch(1)`` is told every decision.
    """
    worlds, dim = env.latent.shape
    names = ("obs", "latent", "end_effector", "root_pos", "root_quat", "ends", "fell", "tried")
    rows: dict[str, list[torch.Tensor]] = {name: [] for name in names}
    tried = torch.ones(worlds, dtype=torch.bool, device=env.device)
    z, left = sample_latents(worlds, dim, generator), _holds(worlds, config, generator)
    ends = torch.zeros_like(tried)
    for _ in range(config.decisions):
        state, obs = env.env.state, env.observe()
        own = None if policy is None else policy(obs)
        changing = select(ends)
        z, left, tried = z.clone(), left.clone(), tried.clone()
        near = None if own is None else own[changing]
        put(z, changing, _drawn(len(changing), dim, near, config, generator))
        put(left, changing, _holds(len(changing), config, generator))
        if own is not None:
            put(tried, changing, ~tried[changing])
        chosen = z if own is None else torch.where(tried[:, None], z, own)
        now = (obs, chosen, env.env.end_effector(), state.root_pos, state.root_quat)
        decision = env.step(chosen)
        left = left - 1
        ends = decision.done | (left <= 0)
        for name, value in zip(names, (*now, ends, decision.fell, tried), strict=True):
            rows[name].append(value)
        env.reset(decision.done)
        if watch is not None:
            watch(1)
    return summarised({name: torch.stack(values) for name, values in rows.items()})


def summarised(series: dict[str, torch.Tensor]) -> Trials:
    """What came of every decision under a random latent.

    Args:
        series: (T, N, ...) what was seen before each decision, ``obs``, ``latent``,
            ``end_effector`` [m], ``root_pos`` [m], ``root_quat``; and bool, of each decision:
            ``ends``, the last one under its latent; ``fell``; ``tried``, the latent is random.
    """
    steps, worlds = series["ends"].shape
    end = _held_until(series["ends"])
    now = torch.arange(steps, device=end.device)[:, None].expand(steps, worlds)
    fell_at_end = series["fell"].gather(0, end)
    reached, standing, fell = [], [], []
    for offset in OFFSETS:
        later = now + offset
        place = later.clamp_max(steps - 1)[..., None].expand(steps, worlds, 3)
        moved = series["end_effector"].gather(0, place) - series["root_pos"]
        reached.append(rotate_inverse(series["root_quat"], moved))
        standing.append(later <= end)
        fell.append((later > end) & fell_at_end)
    known = torch.stack(standing, dim=2), torch.stack(fell, dim=2)
    keep = series["tried"] & (known[0] | known[1]).any(dim=2)
    seen = (series[name] for name in ("obs", "latent", "root_pos", "root_quat"))
    what_came = (torch.stack(reached, dim=2), *known)
    return Trials(*(values[keep] for values in (*seen, *what_came)))


def _drawn(
    count: int,
    dim: int,
    near: torch.Tensor | None,
    config: SkillDynamicsConfig,
    generator: torch.Generator,
) -> torch.Tensor:
    """(n, d) unit latents, uniform on the sphere but for a share that lies around the policy's
    ``near`` (n, d).
    """
    latents = sample_latents(count, dim, generator)
    if near is None:
        return latents
    around = project(near + scatter(count, dim, config.near_spread, generator))
    lot = torch.rand(count, 1, generator=generator, device=generator.device)
    return torch.where(lot < config.near_share, around, latents)


def _holds(count: int, config: SkillDynamicsConfig, generator: torch.Generator) -> torch.Tensor:
    return torch.randint(
        config.hold[0], config.hold[1] + 1, (count,), generator=generator, device=generator.device
    )


def _held_until(ends: torch.Tensor) -> torch.Tensor:
    """(T, N) for each decision the first one from it on at which ``ends`` (T, N) is true, or the
    last of all.
    """
    last = len(ends) - 1
    held = torch.full(ends.shape, last, device=ends.device)
    for step in range(last - 1, -1, -1):
        held[step] = torch.where(ends[step], step, held[step + 1])
    return held
