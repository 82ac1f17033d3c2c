"""Pretraining of the high level by hindsight relabelling.

Random latents are held for a while each. The point that the end effector reached is taken as the
target of that latent, from the state in which the latent began (hindsight relabelling,
Andrychowicz et al. 2017; cloned as in Ghosh et al. 2021). The policy is fitted to these pairs, and
PPO starts from it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Annotated

import torch
from rsl_rl.models import MLPModel
from tensordict import TensorDict

from lacoloco.datasets.config_values import Rising, Within
from lacoloco.datasets.rotations import rotate_inverse
from lacoloco.pipelines.learn.latents import sample_latents
from lacoloco.pipelines.masking import put, select
from lacoloco.pipelines.sim.commands import TargetCommand, uniform
from lacoloco.pipelines.sim.hierarchical_env import LatentSteeredEnv
from lacoloco.robots.numbers import HindsightDistances

SEGMENT_START_DECISIONS = 3
"""Decisions after a change of latent that become examples. Later states already show the latent."""
NORM_WEIGHT = 0.1


@dataclass(frozen=True)
class HindsightConfig:
    """Pretraining by hindsight relabelling.

    Attributes:
        decisions: Random decisions per world. 0 starts from a random network.
        hold: Fewest and most decisions for which a latent is held.
        steps: Gradient steps.
        batch: Examples per gradient step.
    """

    decisions: Annotated[int, Within(0, 100_000)] = 100
    hold: Annotated[tuple[int, int], Within(1, 100_000), Rising()] = (5, 25)
    steps: Annotated[int, Within(1, 10**7)] = 1500
    batch: Annotated[int, Within(1, 2**20)] = 2048


@dataclass(frozen=True)
class RelabellingBuffer:
    """T decisions of N worlds, each as it was taken.

    Attributes:
        obs: (T, N, H) high-level observations.
        latent: (T, N, d) unit latents.
        end_effector: (T, N, 3) world position of the end effector [m].
        root_pos: (T, N, 3) world [m].
        root_quat: (T, N, 4) wxyz.
        segment_end: (T, N) last decision before the latent changes or the episode ends.
        segment_starts: (n,) rows t N + world of the first decisions after a change of latent.
    """

    obs: torch.Tensor
    latent: torch.Tensor
    end_effector: torch.Tensor
    root_pos: torch.Tensor
    root_quat: torch.Tensor
    segment_end: torch.Tensor
    segment_starts: torch.Tensor


def explore(
    env: LatentSteeredEnv,
    config: HindsightConfig,
    generator: torch.Generator,
    watch: Callable[[int], None] | None = None,
) -> RelabellingBuffer:
    """Hold random latents in every world and remember what came of them; ``watch(1)`` is told every
    decision.
    """
    worlds, dim = env.latent.shape
    rows: dict[str, list[torch.Tensor]] = {
        name: [] for name in ("obs", "latent", "end_effector", "root_pos", "root_quat", "ends")
    }
    z, left = sample_latents(worlds, dim, generator), _holds(worlds, config, generator)
    for _ in range(config.decisions):
        state = env.env.state
        now = (env.observe(), z, env.env.end_effector(), state.root_pos, state.root_quat)
        decision = env.step(z)
        left = left - 1
        ends = decision.done | (left <= 0)
        for name, value in zip(rows, (*now, ends), strict=True):
            rows[name].append(value)
        env.reset(decision.done)
        if watch is not None:
            watch(1)
        changing = select(ends)
        z, left = z.clone(), left.clone()
        put(z, changing, sample_latents(len(changing), dim, generator))
        put(left, changing, _holds(len(changing), config, generator))
    series = {name: torch.stack(values) for name, values in rows.items()}
    ends = series.pop("ends")
    return RelabellingBuffer(
        **series,
        segment_end=_segment_end(ends),
        segment_starts=torch.nonzero(_fresh(ends).flatten()).flatten(),
    )


def relabel(
    memory: RelabellingBuffer,
    command: TargetCommand,
    distances: HindsightDistances,
    count: int,
    generator: torch.Generator,
) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
    """Draw examples: (count, 3) targets in the base frame, (count,) rows of the flattened memory,
    (count,) weights.

    A latent that lifted the end effector into the targets' heights serves the point it came to. One
    that took the base somewhere serves all points in that direction, of any height, and weighs more
    the faster it went. Others weigh nothing.
    """
    steps, worlds = memory.segment_end.shape
    rows = memory.segment_starts[
        torch.randint(
            0, len(memory.segment_starts), (count,), generator=generator, device=generator.device
        )
    ]
    now, world = rows // worlds, rows % worlds
    span = memory.segment_end[now, world] - now
    chance, reach = torch.rand(2, count, generator=generator, device=generator.device)
    later = (now + 1 + (chance * span).long()).clamp_max(steps - 1)
    start, end = memory.end_effector[now, world], memory.end_effector[later, world]
    # Of the base: an arm goes far where nobody walks.
    moved = (memory.root_pos[later, world] - memory.root_pos[now, world])[:, :2]
    distance = moved.norm(dim=-1)
    walks = distance > distances.stride
    beyond = _beyond(start, moved, reach, command, distances, generator)
    target = torch.where(walks[:, None], beyond, end)
    weight = _weight(distance / (later - now).clamp_min(1), walks, end, command) * (span > 0)
    local = rotate_inverse(memory.root_quat[now, world], target - memory.root_pos[now, world])
    return local, rows, weight


def _beyond(
    start: torch.Tensor,
    moved: torch.Tensor,
    reach: torch.Tensor,
    command: TargetCommand,
    distances: HindsightDistances,
    generator: torch.Generator,
) -> torch.Tensor:
    """(count, 3) points from ``start`` (count, 3) in the direction of ``moved`` (count, 2), as far
    as or farther than it, as ``reach`` in [0, 1] says, up to ``farthest`` or the farthest target,
    at heights that targets have.
    """
    farthest = max(distances.farthest, command.farthest())
    stretch = farthest / moved.norm(dim=-1).clamp_min(distances.stride) - 1.0
    stretch = 1.0 + reach * stretch.clamp_min(0.0)
    planar = start[:, :2] + moved * stretch[:, None]
    return torch.cat((planar, uniform((command.z,), len(start), generator)), dim=-1)


def _weight(
    speed: torch.Tensor, walks: torch.Tensor, end: torch.Tensor, command: TargetCommand
) -> torch.Tensor:
    """(count,) relative speed of those that walk; of the others, 1 where ``end`` is high enough."""
    lifted = end[:, 2] > command.z[0]
    return torch.where(walks, speed / speed[walks].mean().clamp_min(1e-6), lifted.float())


def clone_hindsight(
    actor: MLPModel,
    memory: RelabellingBuffer,
    command: TargetCommand,
    columns: dict[str, slice],
    distances: HindsightDistances,
    config: HindsightConfig,
    generator: torch.Generator,
    learning_rate: float = 1e-3,
    watch: Callable[[int], None] | None = None,
) -> float:
    """Fit the direction of the actor's mean to the latents that served; returns the mean cosine at
    the end.

    ``columns`` says where an observation holds ``target`` and ``last_latent``. The last latent is
    drawn anew: it must not matter yet. ``watch(1)`` is told every gradient step.
    """
    obs, latent = memory.obs.flatten(0, 1), memory.latent.flatten(0, 1)
    optimizer = torch.optim.Adam(actor.mlp.parameters(), lr=learning_rate, fused=True)
    agreement = []
    for step in range(config.steps):
        optimizer.param_groups[0]["lr"] = learning_rate * (1.0 - step / config.steps)
        target, rows, weight = relabel(memory, command, distances, config.batch, generator)
        seen = obs[rows].clone()
        seen[:, columns["target"]] = target
        seen[:, columns["last_latent"]] = sample_latents(len(seen), latent.shape[1], generator)
        raw = actor(TensorDict({"policy": seen}, batch_size=[len(seen)]))
        cosine = torch.nn.functional.cosine_similarity(raw, latent[rows], dim=-1)
        weight = weight / weight.sum().clamp_min(1e-6)
        loss = -(cosine * weight).sum() + NORM_WEIGHT * (raw.norm(dim=-1) - 1.0).square().mean()
        optimizer.zero_grad(set_to_none=True)
        loss.backward()
        optimizer.step()
        agreement.append((cosine.detach() * weight).sum())
        if watch is not None:
            watch(1)
    return float(torch.stack(agreement[-max(1, config.steps // 10) :]).mean())


def _holds(count: int, config: HindsightConfig, generator: torch.Generator) -> torch.Tensor:
    return torch.randint(
        config.hold[0], config.hold[1] + 1, (count,), generator=generator, device=generator.device
    )


def _fresh(ends: torch.Tensor) -> torch.Tensor:
    """(T, N) bool, the first ``SEGMENT_START_DECISIONS`` decisions after a change of latent."""
    fresh = torch.zeros_like(ends)
    for back in range(1, SEGMENT_START_DECISIONS + 1):
        fresh[back:] |= ends[:-back]
    fresh[:SEGMENT_START_DECISIONS] = True
    return fresh


def _segment_end(ends: torch.Tensor) -> torch.Tensor:
    """(T, N) for each decision the first one from it on at which ``ends`` (T, N) is true, or the
    last of all.
    """
    last = len(ends) - 1
    until = torch.full(ends.shape, last, device=ends.device)
    for step in range(last - 1, -1, -1):
        until[step] = torch.where(ends[step], step, until[step + 1])
    return until
