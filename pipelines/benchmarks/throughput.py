"""How fast the environments and the training are, next to the bare engine in the same run.

Absolute rates on shared machines mean little; the ratio to the engine, taken in turns with it,
does.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import partial
from statistics import median
from typing import Annotated, Any, Literal, cast

import numpy as np
import torch

from lacoloco.datasets.clip import Clip
from lacoloco.datasets.config_values import Within, Worlds
from lacoloco.datasets.hardware import cores
from lacoloco.datasets.motion_library import MotionLibrary
from lacoloco.datasets.rotations import from_yaw
from lacoloco.pipelines import train_low
from lacoloco.pipelines.benchmarks.timer import Stopwatch
from lacoloco.pipelines.learn.ase import Discriminator
from lacoloco.pipelines.low_level.trainer import LowTrainer
from lacoloco.pipelines.sim.bare_engine import bare_engine
from lacoloco.pipelines.sim.env import LeggedEnv
from lacoloco.pipelines.sim.tasks import load_task
from lacoloco.robots.registry import load_robot
from lacoloco.robots.spec import RobotSpec

ACTION_STD = 0.3
"""Standard deviation of the random actions: an early policy's."""


Recipe = Literal["smoke", "laptop", "gpu", "paper"]
"""A preset of train-low."""


@dataclass(frozen=True)
class BenchConfig:
    """How much is measured.

    Attributes:
        worlds: parallel worlds.
        steps: control steps per round of ``sim``.
        rounds: rounds of ``sim`` and iterations of ``train``; medians count.
        seconds: no further round is begun after so many, but two are measured.
        clips: ten-second clips of the made-up library that ``train`` imitates.
        recipe: preset of ``train-low`` that ``train`` takes everything else from.
    """

    worlds: Worlds = 512
    steps: Annotated[int, Within(1, 10**6)] = 40
    rounds: Annotated[int, Within(1, 10_000)] = 9
    seconds: Annotated[float, Within(0, math.inf)] = math.inf
    clips: Annotated[int, Within(1, 100_000)] = 140
    recipe: Recipe = "laptop"

    def turns(self) -> Iterator[int]:
        """The numbers of the rounds, as long as there is time."""
        begin = time.perf_counter()
        for index in range(self.rounds):
            if index >= 2 and time.perf_counter() - begin > self.seconds:
                return
            yield index


PRESETS: dict[str, Callable[[], BenchConfig]] = {
    "smoke": lambda: BenchConfig(worlds=8, steps=4, rounds=2, clips=2),
    "laptop": lambda: BenchConfig(),
    "gpu": lambda: BenchConfig(worlds=4096, recipe="gpu"),
    "paper": lambda: BenchConfig(worlds=4096, recipe="paper"),
}


def bench_sim(
    config: BenchConfig, *, robot: str, task: str = "walk", device: str = "cpu"
) -> dict[str, Any]:
    """The environment loop: physics, rewards, constraints, resets, observations, under random
    actions.

    Returns:
        ``steps_per_second`` and ``engine_steps_per_second`` (control steps), ``ratio_to_engine``
        (median over pairs of rounds), and ``shares`` of the loop's time by part, measured in
        further rounds.

    Raises:
        RobotError: unknown robot.
        StageError: a device without an engine.
    """
    spec = load_robot(robot)
    env = LeggedEnv(spec, _task(spec, task), config.worlds, seed=0, device=device)
    env.stagger()
    engine, wait = bare_engine(env.physics), _wait_for(device)
    _loop(env, _actions(env, min(50, 2 * config.steps)))
    loops: list[float] = []
    bare: list[float] = []
    for index in config.turns():
        actions = _actions(env, config.steps)
        engine.load(_targets(env, actions))
        legs: list[tuple[list[float], Callable[[], object]]]
        legs = [(loops, partial(_loop, env, actions)), (bare, engine.run)]
        for seconds, leg in legs if index % 2 else reversed(legs):
            seconds.append(_time(leg, wait))
    return {
        **_facts(env, robot, device),
        "task": task,
        **_rates(config.worlds * config.steps, loops, bare),
        "shares": _sim_shares(env, config.steps, max(1, len(loops) // 2), wait),
    }


def bench_train(
    config: BenchConfig,
    *,
    robot: str,
    disc: str = "drail",
    cat: bool = True,
    device: str = "cpu",
) -> dict[str, Any]:
    """The whole low-level training with the configuration of ``config.recipe``, on clips made up
    here.

    Returns:
        As :func:`bench_sim`; the shares are those of a training iteration.

    Raises:
        RobotError: unknown robot.
        StageError: a device without an engine.
    """
    spec, preset = load_robot(robot), train_low.PRESETS[config.recipe]()
    if config.worlds < preset.worlds:  # a smoke test
        preset = replace(
            preset, ppo=replace(preset.ppo, horizon=min(config.steps, preset.ppo.horizon))
        )
        batch = max(64, preset.ase.batch * config.worlds // preset.worlds)
        preset = replace(preset, ase=replace(preset.ase, batch=batch))
    preset = replace(
        preset,
        worlds=config.worlds,
        cat=cat,
        ase=replace(preset.ase, discriminator=cast(Discriminator, disc)),
    )
    preset = replace(
        preset, coverage_every=0
    )  # at some numbers of worlds it would fall into every measured iteration
    library = MotionLibrary(made_up_clips(spec, config.clips), device=device)
    trainer = LowTrainer(spec, library, preset, seed=0, device=device)
    engine, wait = bare_engine(trainer.env.physics), _wait_for(device)
    trainer.iterate(0.0)
    loops, bare = [], []
    for _ in config.turns():
        actions = _actions(trainer.env, preset.ppo.horizon)
        engine.load(_targets(trainer.env, actions))
        bare.append(_time(engine.run, wait))
        # Past the ramp, so that the constraints are at work.
        loops.append(_time(partial(trainer.iterate, 0.9), wait))
    return {
        **_facts(trainer.env, robot, device),
        "method": f"{disc}{'-cat' if cat else ''}",
        **_rates(trainer.samples_per_iteration, loops, bare),
        "shares": _train_shares(trainer, max(1, len(loops) // 3), wait),
    }


def made_up_clips(
    spec: RobotSpec, count: int, seconds: float = 10.0, fps: float = 50.0
) -> list[Clip]:
    """Clips of the size of the paper's: the base glides forward while every joint swings around its
    default.
    """
    times = np.arange(round(seconds * fps)) / fps
    forward = np.column_stack(
        [0.3 * times, 0.0 * times, np.full_like(times, spec.default_height())]
    )
    clips = []
    for index in range(count):
        swing = 0.2 * np.sin(
            2.0 * np.pi * (2.0 * times[:, None] + np.arange(spec.num_joints) / 4 + index / 7)
        )
        joints = np.asarray(spec.default_joint_pos) + swing
        clip = Clip.from_poses(
            f"clip_{index}",
            fps,
            spec.joint_names,
            forward,
            from_yaw(0.0 * times),
            joints,
            skill="walk",
        )
        clips.append(clip)
    return clips


def _task(spec: RobotSpec, name: str) -> Any:
    return load_task(spec, name)


def _actions(env: LeggedEnv, steps: int) -> torch.Tensor:
    return ACTION_STD * torch.randn(steps, env.num_worlds, env.num_actions, device=env.device)


def _targets(env: LeggedEnv, actions: torch.Tensor) -> torch.Tensor:
    return env.default_joint_pos + env.task.action_scale * actions[..., : env.spec.num_joints]


def _loop(env: LeggedEnv, actions: torch.Tensor) -> None:
    for action in actions:
        env.reset(env.step(action).done)
        env.observe()


def _time(leg: Callable[[], object], wait: Callable[[], None]) -> float:
    wait()
    begin = time.perf_counter()
    leg()
    wait()
    return time.perf_counter() - begin


def _wait_for(device: str) -> Callable[[], None]:
    return torch.cuda.synchronize if device.startswith("cuda") else lambda: None


def _facts(env: LeggedEnv, robot: str, device: str) -> dict[str, Any]:
    engine = type(env.physics).__name__
    return {
        "robot": robot,
        "device": device,
        "engine": engine,
        "worlds": env.num_worlds,
        "cores": cores(),
    }


def _rates(samples: int, loops: list[float], bare: list[float]) -> dict[str, float]:
    return {
        "steps_per_second": samples / median(loops),
        "engine_steps_per_second": samples / median(bare),
        "ratio_to_engine": median(alone / whole for alone, whole in zip(bare, loops, strict=True)),
    }


def _sim_shares(
    env: LeggedEnv, steps: int, rounds: int, wait: Callable[[], None]
) -> dict[str, float]:
    watch = Stopwatch(wait)
    parts = {
        "step": "constraints, ends of episodes",
        "reset": "resets",
        "observe": "observations",
        "_reward": "rewards",
    }
    for method, name in {
        **parts,
        "_read": "state",
        "_push": "pushes",
        "_resample": "commands",
    }.items():
        watch.watch(env, method, name)
    watch.watch(env.physics, "step", "physics")
    for _ in range(rounds):
        _loop(env, _actions(env, steps))
    return watch.shares()


def _train_shares(
    trainer: LowTrainer, iterations: int, wait: Callable[[], None]
) -> dict[str, float]:
    watch, env, learner = Stopwatch(wait), trainer.env, trainer.algorithm
    for owner, name, methods in (
        (trainer, "rest of the loop", ("iterate",)),
        (env, "environment", ("step", "reset", "observe", "frame")),
        (env.physics, "physics", ("step", "reset", "push")),
        (learner, "policy inference", ("act", "record", "record_transition")),
        (learner, "returns", ("compute_returns",)),
        (learner, "style rewards", ("_reward_rollout",)),
        (learner, "demonstrations", ("demonstrations",)),
        (learner, "discriminator and encoder", ("_update_style",)),
        (learner, "actor and critic", ("update",)),
    ):
        for method in methods:
            watch.watch(owner, method, name)
    for _ in range(iterations):
        trainer.iterate(0.9)
    return watch.shares()
