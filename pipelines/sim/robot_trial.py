"""Does training get what it needs from a robot? Every task is played for a moment, untrained."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field

import torch

from lacoloco.datasets.clip import Clip
from lacoloco.datasets.motion_library import MotionLibrary
from lacoloco.pipelines.sim.env import LeggedEnv
from lacoloco.pipelines.sim.physics import CONTROL_DT
from lacoloco.pipelines.sim.step import Step
from lacoloco.pipelines.sim.tasks import load_task
from lacoloco.robots.errors import RobotError
from lacoloco.robots.finding import Check
from lacoloco.robots.loading import TOML
from lacoloco.robots.spec import RobotSpec
from lacoloco.robots.tables import Place

WORLDS = 8
MOMENT = 0.1
"""s; a robot that is down so soon after its start was never up."""
STANDING = 0.5
"""s for which it is told to hold its pose."""
MOVING = 0.5
"""s of random actions."""
ACTION_STD = 0.5
"""Of the random actions, raw units: what an untrained policy does."""
STANDS = ("torque", "joint_velocity", "foot_force", "undesired_contact")
"""Constraints that a robot in its default pose has to satisfy, whatever it will learn."""


@dataclass
class _Found:
    """The worst of every kind, and the task and reason it was found with."""

    spec: RobotSpec
    worst: dict[str, tuple[float, Place, str]] = field(default_factory=dict)

    def note(self, kind: str, value: float, place: Place, detail: str) -> None:
        if kind not in self.worst or value > self.worst[kind][0]:
            self.worst[kind] = value, place, detail

    def checks(self) -> Iterator[Check]:
        for kind, (value, place, detail) in self.worst.items():
            limit, unit = LIMITS[kind]
            yield Check(kind, value, limit, unit, f"{place.file}: {place.key}", detail)


UNUSABLE = "tasks: numbers that are not finite"
DIVERGED = "tasks: worlds that diverge"
DOWN = "tasks: episodes that begin fallen"
HELD = "tasks: constraints that standing violates"
LIMITS = {UNUSABLE: (0.0, ""), DIVERGED: (0.0, ""), DOWN: (0.5, ""), HELD: (0.5, "")}
"""Kind of check -> limit (a share, but for the first) and its unit."""


def trial_checks(spec: RobotSpec) -> list[Check]:
    """Play every task of a robot whose tables are right, as training does.

    The robot holds its pose, then moves at random; the task of the low level begins inside a clip.
    What is found is one row per kind, of the task where it is worst.

    Raises:
        RobotError: A task cannot be played at all; one line that names the file and the task.
    """
    found = _Found(spec)
    for name in spec.tasks:
        place = Place(str(spec.folder / TOML)) / "tasks" / name
        task = load_task(spec, name)
        try:
            env = LeggedEnv(spec, task, WORLDS, seed=0, motions=_standing_clip(spec))
        except RobotError as error:
            place.fail(str(error))
        _stand(found, env, place)
        _move(found, env, place)
    return list(found.checks())


def _stand(found: _Found, env: LeggedEnv, place: Place) -> None:
    """Zero actions: nobody may be down at once, and no limit may be too low for standing."""
    task, down = env.task, torch.zeros(WORLDS, dtype=torch.bool)
    held = {c.name: torch.zeros(WORLDS) for c in task.constraints if c.name in STANDS}
    last: dict[str, torch.Tensor] = {}
    steps = round(STANDING / CONTROL_DT)
    for number in range(steps):
        step = env.step(torch.zeros(WORLDS, env.num_actions))
        _look(found, env, step, place)
        if number < round(MOMENT / CONTROL_DT):
            down |= step.fell
        if 2 * number >= steps:
            for name in held:
                last[name] = step.violations[name]
                held[name] += (last[name] > 0.0).any(dim=1) * 2.0 / steps
        env.reset(step.done)
    share = float(down.float().mean())
    detail = f"{share:.0%} of the episodes begin fallen; expected that the default pose, times"
    detail += f" reset.joint_scale {task.reset.joint_scale}, stands"
    found.note(DOWN, share, place / "reset", detail)
    found.note(HELD, 0.0, place / "constraints", "")
    for row, constraint in enumerate(task.constraints):
        if constraint.name in held:
            value = float(held[constraint.name].mean())
            over = float(last[constraint.name].max())
            detail = f"{constraint.name} is violated by standing still, by up to {over:.3g};"
            detail += " expected a limit that allows it"
            found.note(HELD, value, place / "constraints" / row, detail)


def _move(found: _Found, env: LeggedEnv, place: Place) -> None:
    """Random actions: the physics has to bear them."""
    generator = torch.Generator().manual_seed(1)
    for _ in range(round(MOVING / CONTROL_DT)):
        noise = torch.randn(WORLDS, env.num_actions, generator=generator)
        step = env.step(ACTION_STD * noise)
        _look(found, env, step, place)
        env.reset(step.done)
    share = float(env.diverged_total) / WORLDS
    detail = f"the physics diverges {float(env.diverged_total):.0f} times in {WORLDS} worlds under"
    detail += " random actions; expected softer gains or more armature in the MJCF"
    found.note(DIVERGED, share, place, detail)


def _look(found: _Found, env: LeggedEnv, step: Step, place: Place) -> None:
    seen = {"observation": env.observe(), "reward": step.reward, **step.violations}
    broken = [name for name, values in seen.items() if not bool(torch.isfinite(values).all())]
    detail = f"{', '.join(broken)} has numbers that are not finite; expected that none has"
    found.note(UNUSABLE, len(broken), place, detail)


def _standing_clip(spec: RobotSpec) -> MotionLibrary:
    """A second of standing, for the tasks that begin inside a clip."""
    import numpy as np

    frames = round(1.0 / CONTROL_DT)
    pose = np.tile(spec.default_qpos(), (frames, 1))
    clip = Clip.from_poses(
        "standing", 1.0 / CONTROL_DT, spec.joint_names, pose[:, :3], pose[:, 3:7], pose[:, 7:]
    )
    return MotionLibrary([clip])
