"""The metadata of artifacts: what of each schema is a text, a number or a table, and its range.

It is checked when a file is read, before anything is built from it.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping
from typing import Any

from lacoloco.datasets.errors import ArtifactError

Check = Callable[[Any], bool]
LONGEST = 1_000_000
"""Letters of a text, or entries of a list; a clip's table and a task's file are far below."""


class Metadata(dict[str, Any]):
    """Metadata in which a key that is not there is a fault of the file."""

    def __init__(
        self, values: Mapping[str, Any] | Iterable[tuple[str, Any]] = (), path: str = ""
    ) -> None:
        """Keep the values, and the name of the file for messages."""
        super().__init__(values)
        self.path = path

    def __missing__(self, key: str) -> Any:
        """Refuse the file.

        Raises:
            ArtifactError: always.
        """
        raise ArtifactError(
            f"{self.path}: its metadata has no '{key}'; run the stage that made it again"
        )


def _text(value: Any) -> bool:
    return isinstance(value, str) and len(value) <= LONGEST


def _number(low: float, high: float, *, whole: bool = False) -> Check:
    kinds = (int,) if whole else (int, float)

    def holds(value: Any) -> bool:
        return isinstance(value, kinds) and not isinstance(value, bool) and low <= value <= high

    return holds


def _metric(value: Any) -> bool:
    """A number, or none where nothing could be measured."""
    return value is None or (isinstance(value, int | float) and not isinstance(value, bool))


def _or_none(check: Check) -> Check:
    return lambda value: value is None or check(value)


def _either(first: Check, second: Check) -> Check:
    return lambda value: first(value) or second(value)


def _every(check: Check) -> Check:
    return lambda value: (
        isinstance(value, list) and len(value) <= LONGEST and all(map(check, value))
    )


def _table(**fields: Check) -> Check:
    """A table; those of its fields that are there hold their checks."""

    def holds(value: Any) -> bool:
        return isinstance(value, dict) and all(
            check(value[name]) for name, check in fields.items() if name in value
        )

    return holds


def _row(value: Any) -> bool:
    """A row of an evaluation: its policy, and metrics of the kinds that their names end in."""
    return _EVALUATED(value) and all(
        _metric(entry) for name, entry in value.items() if name.endswith(("_pct", "_m"))
    )


_SEED = _number(0, 2**63, whole=True)
_COUNT = _number(0, 10**12, whole=True)
_EVALUATED = _table(
    method=_text,
    seed=_or_none(_SEED),
    policy=_text,
    task=_text,
    episodes=_number(1, 10**7, whole=True),
    not_reached=_COUNT,
    no_progress=_COUNT,
    diverged=_COUNT,
    task_reward=_metric,
    selection_reward=_metric,
    intervals=_table(),
    failure_clusters=_every(_table()),
)
FORMS: dict[str, dict[str, Check]] = {
    "lacoloco/motions": {
        "joint_names": _every(_text),
        "clips": _every(_table()),
        "metrics": _table(clips=_every(_table(key=_text, name=_text, paws=_every(_text)))),
    },
    "lacoloco/policy": {
        "heads": _table(),
        "structure": _table(),
        "metrics": _table(),
        "method": _text,
        "hold_steps": _number(1, 10_000, whole=True),
        "task": _or_none(_table(text=_text, file=_text)),
    },
    "lacoloco/checkpoint": {
        "layout": _COUNT,
        "part": _text,
        "structure": _table(),
        "iteration": _COUNT,
        "elapsed_s": _number(0.0, 1e12),
        "processes": _number(1, 1_000_000, whole=True),
    },
    "lacoloco/evaluation": {
        "rows": lambda value: _every(_row)(value) and len(value) > 0,
        "best": _row,
        "summary": _table(),
        "protocol": _text,
        "shift": _every(_table()),
        "hardware": _table(),
    },
    "lacoloco/playback": {"recordings": _every(_table()), "title": _text},
    # A table of the two networks before the folder had more files.
    "lacoloco/export": {"files": _either(_every(_text), _table()), "max_abs_difference": _metric},
    "lacoloco/switching": {
        "skills": _every(_text),
        "fps": lambda value: _number(0.0, 1e6)(value) and math.isfinite(value),
        "shown": _COUNT,
        "metrics": _table(),
    },
}
"""Schema -> key -> what its value is. A key that is not there is refused when it is needed."""


def checked(schema: str, metadata: Mapping[str, Any], path: str) -> Metadata:
    """The metadata of a file, once each value is what its schema says.

    Raises:
        ArtifactError: one is not; the message names its key.
    """
    for key, check in FORMS.get(schema, {}).items():
        if key in metadata and not check(metadata[key]):
            raise ArtifactError(
                f"{path}: '{key}' in its metadata is of another form than in '{schema}'; restore a"
                " copy, or run the stage that made it again"
            )
    return Metadata(metadata, path)
