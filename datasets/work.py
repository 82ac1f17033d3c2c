"""What a version of a stage is made from: settings, seed, robot and inputs.

It is kept in the version's directory while that is unfinished, so that `--resume` goes on with just
that work; a complete version says the same in the header of its artifact.
"""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from lacoloco.datasets.artifact import Header
from lacoloco.datasets.atomic_write import write_file
from lacoloco.datasets.beside import BEGUN
from lacoloco.datasets.errors import ArtifactError
from lacoloco.datasets.provenance import Parent
from lacoloco.datasets.robot_record import RobotRecord

_MOST_SHOWN = 3


@dataclass(frozen=True)
class Work:
    """Two versions with the same work are the same training, recording or retargeting.

    Attributes:
        config: the resolved configuration, as JSON keeps it.
        seed: seed of the stage.
        robot: name and digest of the robot; an artifact of before knows only its MJCF.
        inputs: the artifacts that the version is made from, in their order; None where the stage
            compares its inputs itself.
        task: text of a task file of the user's own, "" without one.
        command: the command line that began it; not compared.
    """

    config: Mapping[str, Any]
    seed: int | None
    robot: RobotRecord
    inputs: tuple[Parent, ...] | None = None
    task: str = ""
    command: str = ""

    @classmethod
    def of(cls, header: Header) -> Work:
        """The work that a complete artifact came from."""
        task = header.metadata.get("task")
        return cls(
            header.config,
            header.seed,
            header.robot_record,
            header.parents,
            str(task.get("text", "")) if isinstance(task, dict) else "",
            header.command,
        )

    def write(self, directory: Path) -> None:
        """Keep it in the directory of an unfinished version.

        Raises:
            ArtifactError: the file system refuses.
        """
        content = json.dumps(dataclasses.asdict(self), default=_plain)
        write_file(directory / BEGUN, content.encode())

    @classmethod
    def read(cls, directory: Path) -> Work | None:
        """The work of an unfinished version; None where it was not kept or cannot be read."""
        try:
            kept = json.loads((directory / BEGUN).read_text(encoding="utf-8"))
            inputs = kept["inputs"]
            return cls(
                config=dict(kept["config"]),
                seed=kept["seed"],
                robot=RobotRecord(*kept["robot"]),
                inputs=None if inputs is None else tuple(Parent(**one) for one in inputs),
                task=str(kept["task"]),
                command=str(kept["command"]),
            )
        except (OSError, ValueError, KeyError, TypeError):
            return None

    def differences(self, now: Work) -> list[str]:
        """What `now` asks for that is not what this one was begun with, one phrase each."""
        found = [
            f"{key} was {_text(then)}, is {_text(value)}"
            for key, then, value in _changed(_settings(self), _settings(now))
        ]
        if not self.robot.agrees_with(now.robot):
            names = (self.robot.name, now.robot.name)
            changed = f"was {names[0]}, is {names[1]}" if names[0] != names[1] else "has changed"
            found.append(f"the robot {changed}")
        if self.task != now.task:
            found.append("the task file is another one, or has changed")
        if self.inputs is not None and now.inputs is not None:
            found += _other_inputs(self.inputs, now.inputs)
        return found


def in_one_line(differences: list[str]) -> str:
    """The first few differences, and how many more there are."""
    more = len(differences) - _MOST_SHOWN
    return "; ".join(differences[:_MOST_SHOWN]) + (f"; and {more} more" if more > 0 else "")


def _settings(work: Work) -> dict[str, Any]:
    config = json.loads(json.dumps(work.config, default=_plain))  # tuples become lists
    return {"seed": work.seed, **dict(_leaves(config, ""))}


def _leaves(value: Mapping[str, Any], prefix: str) -> Iterator[tuple[str, Any]]:
    for key, inner in value.items():
        if isinstance(inner, dict):
            yield from _leaves(inner, f"{prefix}{key}.")
        else:
            yield f"{prefix}{key}", inner


_ABSENT = object()


def _changed(
    then: Mapping[str, Any], now: Mapping[str, Any]
) -> Iterator[tuple[str, object, object]]:
    for key in {**then, **now}:
        pair = then.get(key, _ABSENT), now.get(key, _ABSENT)
        # Compared as text: NaN equals itself there.
        if json.dumps(pair[0], default=repr) != json.dumps(pair[1], default=repr):
            yield key, *pair


def _text(value: object) -> str:
    return "not there" if value is _ABSENT else json.dumps(value)


def _other_inputs(then: tuple[Parent, ...], now: tuple[Parent, ...]) -> list[str]:
    if [one.sha256 for one in then] == [one.sha256 for one in now]:
        return []
    names = [", ".join(one.path for one in inputs) or "nothing" for inputs in (then, now)]
    if names[0] == names[1]:
        return [f"{names[0]} has changed"]
    return [f"the input was {names[0]}, is {names[1]}"]


def _plain(value: object) -> object:
    if isinstance(value, Path):
        return str(value)
    if hasattr(value, "item"):
        return value.item()
    raise TypeError(f"settings hold no {type(value).__name__}")


def begun_as(directory: Path) -> Work:
    """The work of an unfinished version that is to be continued.

    Raises:
        ArtifactError: it was not kept.
    """
    work = Work.read(directory)
    if work is None:
        raise ArtifactError(
            f"{directory}: does not say what it was begun with; begin again without --resume"
        )
    return work
