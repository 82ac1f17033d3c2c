"""Skill dynamics: a network that tells where a latent will take the end effector (Sharma et al.,
"Dynamics-Aware Unsupervised Discovery of Skills", 2020), and a policy that is made from it.

A latent that is held answers for every target at once: what is learned is where it leads, not
which target it once served. The policy's mean then descends the predicted distance to its target by
its gradient. Regression on latents that came to a target would give their mean instead, which may
lead to none of the places that they lead to.
"""

from __future__ import annotations

from collections.abc import Callable

import torch
from rsl_rl.models import MLPModel
from tensordict import TensorDict

from lacoloco.datasets.rotations import from_yaw, rotate, rotate_inverse, yaw
from lacoloco.pipelines.high_level.config import SkillDynamicsConfig
from lacoloco.pipelines.high_level.trials import OFFSETS, Trials
from lacoloco.pipelines.learn.latents import project, sample_latents
from lacoloco.pipelines.learn.precision import fast_products
from lacoloco.pipelines.sim.commands import TargetCommand, uniform

HIDDEN = 256
NORM_WEIGHT = 0.01
"""On how far the policy's output is from unit length, in which exploration noise is measured."""
SMOOTH = 0.01
"""Of the predicted distance, whose gradient has no direction at 0 [m]."""
LEARNING_RATE = 1e-3


class SkillDynamics(torch.nn.Module):
    """Where the end effector will be, and whether the robot will have fallen, at K ``OFFSETS``.

    Attributes:
        seen_mean, seen_std: (width,) of the observations that it was fitted to.
        place_mean, place_std: (K, 3) of the positions in the base frame [m].
    """

    seen_mean: torch.Tensor
    seen_std: torch.Tensor
    place_mean: torch.Tensor
    place_std: torch.Tensor

    def __init__(self, width: int, dim: int) -> None:
        """For ``width`` observations that are looked at and latents of ``dim``."""
        super().__init__()
        self.layers = torch.nn.Sequential(
            torch.nn.Linear(width + dim, HIDDEN),
            torch.nn.SiLU(),
            torch.nn.Linear(HIDDEN, HIDDEN),
            torch.nn.SiLU(),
            torch.nn.Linear(HIDDEN, 4 * len(OFFSETS)),
        )
        for name, shape in (("seen", (width,)), ("place", (len(OFFSETS), 3))):
            self.register_buffer(f"{name}_mean", torch.zeros(shape))
            self.register_buffer(f"{name}_std", torch.ones(shape))

    def measure(self, seen: torch.Tensor, trials: Trials) -> None:
        """Take mean and spread of the observations (M, width) and of where they led."""
        self.seen_mean, self.seen_std = seen.mean(dim=0), seen.std(dim=0).clamp_min(1e-3)
        for index in range(len(OFFSETS)):
            known = trials.reached[trials.standing[:, index], index]
            if len(known) > 1:
                self.place_mean[index] = known.mean(dim=0)
                self.place_std[index] = known.std(dim=0).clamp_min(1e-3)

    def forward(
        self, seen: torch.Tensor, latent: torch.Tensor
    ) -> tuple[torch.Tensor, torch.Tensor]:
        """(B, width), (B, d) -> (B, K, 3) positions in the base frame [m], (B, K) logits of a
        fall.
        """
        scale = latent.shape[-1] ** 0.5
        known = torch.cat(((seen - self.seen_mean) / self.seen_std, scale * latent), dim=-1)
        out = self.layers(known).float().unflatten(-1, (len(OFFSETS), 4))
        return out[..., :3] * self.place_std + self.place_mean, out[..., 3]


def fit_dynamics(
    model: SkillDynamics,
    trials: Trials,
    seen: torch.Tensor,
    config: SkillDynamicsConfig,
    generator: torch.Generator,
    watch: Callable[[int], None] | None = None,
) -> float:
    """Fit the network to what came of latents; returns the mean error of positions at the end [m].

    ``seen`` (M, width) are the observations that it looks at. ``watch(1)`` is told every step.
    """
    model.measure(seen, trials)
    optimizer = torch.optim.Adam(model.parameters(), lr=LEARNING_RATE)
    errors = []
    for step in range(config.model_steps):
        optimizer.param_groups[0]["lr"] = LEARNING_RATE * (1.0 - step / config.model_steps)
        rows = _draw(len(seen), config.batch, generator)
        standing, fell = trials.standing[rows].float(), trials.fell[rows].float()
        with fast_products(seen.device):
            places, logits = model(seen[rows], trials.latent[rows])
        off = places - trials.reached[rows]
        scaled = (off / model.place_std).square().sum(dim=-1).add(1e-4).sqrt()
        falls = torch.nn.functional.binary_cross_entropy_with_logits(logits, fell, reduction="none")
        loss = _mean(scaled, standing) + _mean(falls, standing + fell)
        optimizer.zero_grad(set_to_none=True)
        loss.backward()
        optimizer.step()
        errors.append(_mean(off.detach().norm(dim=-1), standing))
        if watch is not None:
            watch(1)
    return _late_mean(errors)


def fit_policy(
    actor: MLPModel,
    model: SkillDynamics,
    trials: Trials,
    command: TargetCommand,
    columns: dict[str, slice],
    config: SkillDynamicsConfig,
    generator: torch.Generator,
    watch: Callable[[int], None] | None = None,
) -> float:
    """Let the actor's mean descend the predicted distance to targets; returns that distance, the
    mean over ``OFFSETS`` at the end [m].

    A fall counts as much as the farthest target is away. ``columns`` says where an observation
    holds ``target`` and ``last_latent``. The last latent is drawn anew: it must not matter yet.
    """
    optimizer = torch.optim.Adam(actor.mlp.parameters(), lr=LEARNING_RATE)
    model.requires_grad_(False)
    looked_at, dim = kept_columns(trials.obs.shape[1], columns), trials.latent.shape[1]
    distances = []
    for step in range(config.policy_steps):
        optimizer.param_groups[0]["lr"] = LEARNING_RATE * (1.0 - step / config.policy_steps)
        rows = _draw(len(trials.obs), config.batch, generator)
        obs = trials.obs[rows].clone()
        obs[:, columns["target"]] = targets(trials, rows, command, columns, generator)
        obs[:, columns["last_latent"]] = sample_latents(len(obs), dim, generator)
        with fast_products(obs.device):
            raw = actor(TensorDict({"policy": obs}, batch_size=[len(obs)])).float()
            places, logits = model(obs[:, looked_at], project(raw))
        off = (places - obs[:, None, columns["target"]]).square().sum(dim=-1)
        distance = off.add(SMOOTH**2).sqrt().mean(dim=1)
        cost = distance + command.farthest() * logits.sigmoid().mean(dim=1)
        loss = cost.mean() + NORM_WEIGHT * (raw.norm(dim=-1) - 1.0).square().mean()
        optimizer.zero_grad(set_to_none=True)
        loss.backward()
        optimizer.step()
        distances.append(distance.detach().mean())
        if watch is not None:
            watch(1)
    model.requires_grad_(True)
    return _late_mean(distances)


def targets(
    trials: Trials,
    rows: torch.Tensor,
    command: TargetCommand,
    columns: dict[str, slice],
    generator: torch.Generator,
) -> torch.Tensor:
    """(n, 3) targets in the base frame [m]: every other one is the row's own; the others are as
    far ahead and to the side as some latent brought the end effector, at a height of the task's.
    """
    own = trials.obs[rows, columns["target"]]
    known = torch.nonzero(trials.standing[:, 0]).flatten()
    if not len(known):  # all of them fell at once
        return own
    ahead = trials.ahead(known[_draw(len(known), len(rows), generator)])
    height = uniform((command.z,), len(rows), generator) - trials.root_pos[rows, 2:]
    quat = trials.root_quat[rows]
    world = rotate(from_yaw(yaw(quat)), torch.cat((ahead, height), dim=-1))
    near: torch.Tensor = rotate_inverse(quat, world)
    # By their place in the batch: rows of even numbers may all be of worlds without noise.
    place = torch.arange(len(rows), device=rows.device)
    return torch.where((place % 2 == 0)[:, None], own, near)


def kept_columns(width: int, columns: dict[str, slice]) -> torch.Tensor:
    """Columns of a high-level observation that say something about the robot: not its target, nor
    the latent of before, which is replaced.
    """
    keep = torch.ones(width, dtype=torch.bool)
    keep[columns["target"]] = False
    keep[columns["last_latent"]] = False
    return torch.nonzero(keep).flatten()


def _draw(size: int, count: int, generator: torch.Generator) -> torch.Tensor:
    return torch.randint(0, size, (count,), generator=generator, device=generator.device)


def _mean(values: torch.Tensor, weight: torch.Tensor) -> torch.Tensor:
    return (values * weight).sum() / weight.sum().clamp_min(1.0)


def _late_mean(values: list[torch.Tensor]) -> float:
    return float(torch.stack(values[-max(1, len(values) // 10) :]).mean())
