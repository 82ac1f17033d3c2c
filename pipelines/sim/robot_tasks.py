"""The tasks that a robot has to bring: one or more per stage that trains on it."""

from __future__ import annotations

from dataclasses import dataclass

from lacoloco.pipelines.sim.commands import COMMANDS
from lacoloco.pipelines.sim.tasks import load_task
from lacoloco.robots.loading import TOML
from lacoloco.robots.spec import RobotSpec
from lacoloco.robots.tables import Place


@dataclass(frozen=True)
class Needed:
    """What a stage expects of a task in ``robot.toml``.

    Attributes:
        stage: The verb that cannot do without it.
        command: Type of its command, a key of ``COMMANDS``; None: it has none.
    """

    stage: str
    command: str | None


NEEDED: dict[str, Needed] = {
    "walk": Needed("generate", "velocity"),
    "reach_in_place": Needed("generate", "target"),
    "imitate": Needed("train-low", None),
    "reach": Needed("train-high", "target"),
}
"""Name of a task -> what is expected of it. What has a command is rewarded for it, too."""


def check_tasks(spec: RobotSpec) -> None:
    """Refuse a robot whose tasks are not all there and right.

    Raises:
        RobotError: One line that names the file, the key and what is expected.
    """
    tasks = Place(str(spec.folder / TOML)) / "tasks"
    for name, needed in NEEDED.items():
        if name not in spec.tasks:
            (tasks / name).fail(f"missing; expected a table, the task of {needed.stage}")
    for name in spec.tasks:
        task = load_task(spec, name)
        if name in NEEDED:
            command = NEEDED[name].command
            if type(task.command) is not (type(None) if command is None else COMMANDS[command]):
                expected = "no command" if command is None else f"a command of type {command!r}"
                found = spec.tasks[name].get("command")
                (tasks / name / "command").expected(f"{expected} for {NEEDED[name].stage}", found)
            if command is not None and not task.rewards:
                (tasks / name / "rewards").fail("missing; expected at least one reward term")
