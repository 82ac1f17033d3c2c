"""Skill dynamics: a network that tells where a latent will take the end effector (Sharma et al.,
"Dynamics-Aware Unsupervised Discovery of Skills", 2020), and a policy that is made from it.

A latent that is held answers for every target at once: what is learned is where it leads, not
which target it once served. The policy's mean then descends the predicted distance to its target by
its gradient. Regression on latents that came to a target would give their mean instead, which may
lead to none of the places that they lead to.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable

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
        looked_at: (W,) columns of an observation that say something about the robot: not its
            target, nor the latent of before, which is replaced.
        seen_mean, seen_std: (W,) of these columns in what it was fitted to.
        place_mean, place_std: (K, 3) of the positions in the base frame [m].
    """

    looked_at: torch.Tensor
    seen_mean: torch.Tensor
    seen_std: torch.Tensor
    place_mean: torch.Tensor
    place_std: torch.Tensor

    def __init__(self, width: int, dim: int, columns: dict[str, slice]) -> None:
        """For observations of ``width`` and latents of ``dim``; ``columns`` says where an
        observation holds ``target`` and ``last_latent``.
        """
        super().__init__()
        keep = torch.ones(width, dtype=torch.bool)
        keep[columns["target"]] = False
        keep[columns["last_latent"]] = False
        self.register_buffer("looked_at", torch.nonzero(keep).flatten())
        seen = len(self.looked_at)
        self.layers = torch.nn.Sequential(
            torch.nn.Linear(seen + dim, HIDDEN),
            torch.nn.SiLU(),
            torch.nn.Linear(HIDDEN, HIDDEN),
            torch.nn.SiLU(),
            torch.nn.Linear(HIDDEN, 4 * len(OFFSETS)),
        )
        for name, shape in (("seen", (seen,)), ("place", (len(OFFSETS), 3))):
            self.register_buffer(f"{name}_mean", torch.zeros(shape))
            self.register_buffer(f"{name}_std", torch.ones(shape))

    def measure(self, trials: Trials) -> None:
        """Take mean and spread of observations and of where they led."""
        seen = trials.obs[:, self.looked_at]
        self.seen_mean, self.seen_std = seen.mean(dim=0), seen.std(dim=0).clamp_min(1e-3)
        for index in range(len(OFFSETS)):
            known = trials.reached[trials.standing[:, index], index]
            if len(known) > 1:
                self.place_mean[index] = known.mean(dim=0)
                self.place_std[index] = known.std(dim=0).clamp_min(1e-3)

    def forward(self, obs: torch.Tensor, latent: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        """(B, H), (B, d) -> (B, K, 3) positions in the base frame [m], (B, K) logits of a fall."""
        scale = latent.shape[-1] ** 0.5
        seen = (obs[:, self.looked_at] - self.seen_mean) / self.seen_std
        known = torch.cat((seen, scale * latent), dim=-1)
        out = self.layers(known).float().unflatten(-1, (len(OFFSETS), 4))
        return out[..., :3] * self.place_std + self.place_mean, out[..., 3]


def fit_dynamics(
    model: SkillDynamics,
    trials: Trials,
    config: SkillDynamicsConfig,
    generator: torch.Generator,
    watch: Callable[[int], None] | None = None,
) -> float:
    """Fit the network to what came of latents; returns the mean error of positions at the end [m].

    ``watch(1)`` is told every gradient step.
    """
    model.measure(trials)

    def loss() -> tuple[torch.Tensor, torch.Tensor]:
        rows = _sample_rows(len(trials.obs), config.batch, generator)
        standing, fell = trials.standing[rows].float(), trials.fell[rows].float()
        with fast_products(trials.obs.device):
            places, logits = model(trials.obs[rows], trials.latent[rows])
        off = places - trials.reached[rows]
        scaled = (off / model.place_std).square().sum(dim=-1).add(1e-4).sqrt()
        falls = torch.nn.functional.binary_cross_entropy_with_logits(logits, fell, reduction="none")
        error = _mean(off.detach().norm(dim=-1), standing)
        return _mean(scaled, standing) + _mean(falls, standing + fell), error

    return _descend(model.parameters(), config.model_steps, loss, watch)


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
    dim = trials.latent.shape[1]

    def loss() -> tuple[torch.Tensor, torch.Tensor]:
        rows = _sample_rows(len(trials.obs), config.batch, generator)
        obs = trials.obs[rows].clone()
        obs[:, columns["target"]] = targets(trials, rows, command, columns, generator)
        obs[:, columns["last_latent"]] = sample_latents(len(obs), dim, generator)
        with fast_products(obs.device):
            raw = actor(TensorDict({"policy": obs}, batch_size=[len(obs)])).float()
            places, logits = model(obs, project(raw))
        off = (places - obs[:, None, columns["target"]]).square().sum(dim=-1)
        distance = off.add(SMOOTH**2).sqrt().mean(dim=1)
        cost = distance + command.farthest() * logits.sigmoid().mean(dim=1)
        length = (raw.norm(dim=-1) - 1.0).square().mean()
        return cost.mean() + NORM_WEIGHT * length, distance.detach().mean()

    model.requires_grad_(False)
    reached = _descend(actor.mlp.parameters(), config.policy_steps, loss, watch)
    model.requires_grad_(True)
    return reached


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
    ahead = trials.ahead(known[_sample_rows(len(known), len(rows), generator)])
    height = uniform((command.z,), len(rows), generator) - trials.root_pos[rows, 2:]
    quat = trials.root_quat[rows]
    world = rotate(from_yaw(yaw(quat)), torch.cat((ahead, height), dim=-1))
    reachable: torch.Tensor = rotate_inverse(quat, world)
    # By their place in the batch: rows of even numbers may all be of worlds without noise.
    place = torch.arange(len(rows), device=rows.device)
    return torch.where((place % 2 == 0)[:, None], own, reachable)


def _descend(
    parameters: Iterable[torch.nn.Parameter],
    steps: int,
    loss: Callable[[], tuple[torch.Tensor, torch.Tensor]],
    watch: Callable[[int], None] | None,
) -> float:
    """Descend a loss, at a rate that falls to 0; returns the mean over the last tenth of the steps
    of what ``loss()`` gives beside it.
    """
    optimizer, told = torch.optim.Adam(parameters, lr=LEARNING_RATE), []
    for step in range(steps):
        optimizer.param_groups[0]["lr"] = LEARNING_RATE * (1.0 - step / steps)
        value, metric = loss()
        optimizer.zero_grad(set_to_none=True)
        value.backward()
        optimizer.step()
        told.append(metric)
        if watch is not None:
            watch(1)
    return float(torch.stack(told[-max(1, steps // 10) :]).mean())


def _sample_rows(size: int, count: int, generator: torch.Generator) -> torch.Tensor:
    return torch.randint(0, size, (count,), generator=generator, device=generator.device)


def _mean(values: torch.Tensor, weight: torch.Tensor) -> torch.Tensor:
    return (values * weight).sum() / weight.sum().clamp_min(1.0)
