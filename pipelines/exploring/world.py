"""One robot that somebody steers by hand, or lets a high level steer, step by step."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import torch

from lacoloco.pipelines.learn.latents import project, sample_latents
from lacoloco.pipelines.policies import Policy, steered
from lacoloco.pipelines.sim.disturbances.config import UNDISTURBED
from lacoloco.pipelines.sim.env import LeggedEnv
from lacoloco.pipelines.sim.hierarchical_env import HOLD_STEPS
from lacoloco.pipelines.sim.randomisation import NO_RANDOMISATION
from lacoloco.pipelines.sim.tasks import ResetConfig, Task, imitate_task
from lacoloco.robots.spec import RobotSpec

PUSH = 0.8
"""m/s that a push adds to the base by default; trainings push with about half of it."""


class ExploredWorld:
    """A robot under mean actions, without noise and randomisation, motors as strong as they are.

    Attributes:
        spec: The robot.
        dim: Width of a latent.
        has_target: Whether there is a high level that can steer towards a target.
        high_steers: Whether it does; else the latent is held until it is changed.
        fell: Whether the robot has fallen since the last reset.
    """

    def __init__(
        self, policies: Mapping[str, Policy], spec: RobotSpec, task: Task | None, *, seed: int = 0
    ) -> None:
        """Let the robot stand; it holds a latent drawn from ``seed``.

        Args:
            policies: By role; ``low``, and perhaps ``high``.
            spec: Their robot.
            task: What the high level was trained on; None without one.
            seed: Of latents, pushes and targets.
        """
        self.spec, self._policies = spec, policies
        low = policies["low"]
        self.dim = low.head.sizes["latent"]
        task = task or imitate_task(spec, constrained=False)
        self._env = LeggedEnv(spec, _quiet(task), 1, seed=seed)
        self._steered = steered(self._env, policies)
        self.has_target = "high" in policies and task.has_target
        self.high_steers = self.has_target
        self._generator = torch.Generator().manual_seed(seed)
        self._latent = sample_latents(1, self.dim, self._generator)
        self._step, self.fell = 0, False

    @property
    def latent(self) -> np.ndarray:
        """(d,) the unit latent in force."""
        return self._latent[0].numpy().copy()

    @property
    def qpos(self) -> np.ndarray:
        """(7 + J,) position [m], orientation wxyz and joints [rad] of the robot."""
        return self._env.physics.qpos[0].double().numpy()

    @property
    def frame(self) -> torch.Tensor:
        """(10 + 2J,) clean style frame."""
        return self._env.frame()[0]

    @property
    def end_effector_height(self) -> float:
        """Of the end effector above the floor [m]."""
        return float(self._env.end_effector()[0, 2])

    @property
    def friction(self) -> float:
        """Of the feet on the ground."""
        return float(self._env.parameters.friction[0])

    @property
    def target(self) -> np.ndarray:
        """(3,) where the end effector is asked to be [m]."""
        return self._env.command[0].double().numpy()

    @property
    def target_error(self) -> float:
        """Distance of the end effector from the target [m]."""
        return float(self._env.target_error()[0])

    def step(self) -> None:
        """One control step of 20 ms."""
        if self.high_steers and self._step % HOLD_STEPS == 0:
            self._latent = project(self._policies["high"](self._steered.observe()))
        self._steered.latent = self._latent
        action = self._policies["low"](self._steered.observe_low(), self._latent)
        step = self._env.step(action)
        self.fell |= bool(step.fell[0])
        self._step += 1
        if not bool(step.valid[0]):
            self.reset()

    def take(self, latent: np.ndarray) -> None:
        """Hold a latent (d,) from now on, whatever steered before; its length is made one."""
        self._latent = project(torch.as_tensor(latent, dtype=torch.float32)[None])
        self.high_steers = False

    def take_random(self) -> None:
        """Hold a latent drawn uniformly from the sphere."""
        self.take(sample_latents(1, self.dim, self._generator)[0].numpy())

    def push(self, speed: float = PUSH) -> None:
        """Push the base in a random direction along the ground, by this speed [m/s]."""
        angle = 2.0 * torch.pi * torch.rand(1, generator=self._generator)
        velocity = torch.zeros(1, 6)
        velocity[0, 0], velocity[0, 1] = speed * angle.cos(), speed * angle.sin()
        self._env.physics.push(torch.zeros(1, dtype=torch.long), velocity)

    def reset(self) -> None:
        """Stand up at the origin; latent, friction and target stay."""
        target = self._env.command.clone()
        self._steered.reset(torch.ones(1, dtype=torch.bool))
        self._env.command = target
        self._step, self.fell = 0, False

    def set_friction(self, friction: float) -> None:
        """Change the floor under the feet."""
        value = torch.tensor([friction])
        self._env.parameters = replace(self._env.parameters, friction=value)
        self._env.physics.set_parameters(self._env.parameters)

    def set_target(self, target: np.ndarray) -> None:
        """Ask the end effector to be at a point (3,) of the world [m]."""
        self._env.command = torch.as_tensor(target, dtype=torch.float32)[None].clone()


def rotated_to(latent: np.ndarray, index: int, value: float) -> np.ndarray:
    """The unit vector nearest to a latent (d,) with ``value`` in [-1, 1] at ``index``."""
    others = np.delete(latent, index).astype(np.float64)
    length = np.linalg.norm(others)
    if length < 1e-6:  # from a pole, all ways lead away alike
        others, length = np.ones_like(others), np.sqrt(len(others))
    others *= np.sqrt(max(0.0, 1.0 - value**2)) / length
    return np.insert(others, index, value)


def _quiet(task: Task) -> Task:
    """The task as it is shown: from a standing start, ended by nothing but a hand."""
    return replace(
        task,
        noise=0.0,
        training_limits=False,
        resample_s=None,
        randomisation=NO_RANDOMISATION,
        disturbances=UNDISTURBED,
        reset=ResetConfig(heading=0.0, lin_vel=0.0, ang_vel=0.0, joint_scale=(1.0, 1.0)),
    )
