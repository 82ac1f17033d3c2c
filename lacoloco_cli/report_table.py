"""Results as Markdown: the rows of one evaluation, mean and spread over seeds, and its origin."""

from __future__ import annotations

import re
import statistics
import textwrap
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from lacoloco_cli.failures import UserError

if TYPE_CHECKING:
    from lacoloco.datasets.artifact import Artifact

Row = Mapping[str, Any]

SCHEMA = "lacoloco/evaluation"
SUCCESS_M = {"success_5cm_pct": 0.05, "success_30cm_pct": 0.30}
"""Key of a success rate -> distance from the target [m] that counts as success."""
WIDTH = 120
"""Columns of the text that is written around tables."""
HASH_LETTERS = 16
"""As many letters of a hash as a reader can compare."""
NOTE_OVER_SEEDS = (
    "`+-` is the sample standard deviation over seeds, `[low, high]` behind it the 95 % interval"
    " of the mean over seeds (Student's t)."
)
NOTE_OVER_EPISODES = (
    "`[low, high]` in the row of a seed is the 95 % interval over its episodes (bootstrap)."
)
NAME = re.compile(r"[\w.+-]+")


@dataclass(frozen=True)
class Column:
    """One metric of an evaluation.

    Attributes:
        heading: with the unit in brackets.
        scale: from the unit of the artifact to that of the heading.
        digits: after the point.
    """

    heading: str
    scale: float
    digits: int


COLUMNS = {
    "ee_error_mean_m": Column("error mean [cm]", 100.0, 2),
    "ee_error_std_m": Column("std over episodes [cm]", 100.0, 2),
    "ee_error_median_m": Column("median [cm]", 100.0, 2),
    "success_5cm_pct": Column("within 5 cm [%]", 1.0, 2),
    "success_30cm_pct": Column("within 30 cm [%]", 1.0, 2),
    "contact_violation_pct": Column("contact violation [%]", 1.0, 4),
    "contact_violation_original_pct": Column("as the original counts it [%]", 1.0, 4),
    "falls_pct": Column("falls [%]", 1.0, 3),
}
"""Key of an evaluation's row -> how it is shown."""


def section(name: str, artifact: Artifact) -> str:
    """One evaluation between the markers of its name; the same artifact gives the same text.

    Args:
        name: Of the report; see :func:`merge`.
        artifact: An evaluation.

    Raises:
        UserError: The artifact is none, or the name holds more than letters, digits and `.+-_`.
    """
    begin, end = markers(name)
    if artifact.schema != SCHEMA:
        raise UserError(f"{artifact.path}: is {artifact.schema}; a report takes evaluations only")
    shift = artifact.metadata.get("shift", [])
    more = [*shift_table(shift), ""] if shift else []
    lines = [begin, "", *table(rows_of(artifact)), "", *more, *origin(artifact), "", end, ""]
    return "\n".join(lines)


def markers(name: str) -> tuple[str, str]:
    """The comments that a report of this name stands between.

    Raises:
        UserError: The name would end the comment or spread over two words.
    """
    if not NAME.fullmatch(name):
        raise UserError(f"--name {name}: use letters, digits and any of . + - _")
    return f"<!-- report: {name} -->", f"<!-- end of report: {name} -->"


def merge(text: str, name: str, report: str) -> str:
    """Put a report in the place of the one of the same name; append it where there is none.

    Args:
        text: A Markdown file; what stands outside of the markers is kept as it is.
        name: Of the report.
        report: From :func:`section`.

    Raises:
        UserError: A marker without its partner, or twice.
    """
    begin, end = markers(name)
    counts = text.count(begin), text.count(end)
    if counts == (0, 0):
        before = f"{text.rstrip()}\n\n" if text.strip() else ""
        return f"{before}## {name}\n\n{report}"
    if counts != (1, 1) or text.index(end) < text.index(begin):
        raise UserError(f"report {name}: the file must hold {begin} and {end} once, in this order")
    before, _, rest = text.partition(begin)
    return before + report.rstrip("\n") + rest.partition(end)[2]


def rows_of(artifact: Artifact) -> list[dict[str, Any]]:
    """The evaluation's rows; success rates that it does not state are counted from its episodes."""
    rows = []
    for index, row in enumerate(artifact.metadata["rows"]):
        error, fell = (artifact.arrays.get(f"{index}/{name}") for name in ("error", "fell"))
        counted = {}
        if error is not None and fell is not None:
            counted = {
                key: 100.0 * float(((error <= distance) & ~fell.astype(bool)).mean())
                for key, distance in SUCCESS_M.items()
            }
        rows.append({**counted, **row, "best": row == artifact.metadata["best"]})
    return rows


def table(rows: Sequence[Row]) -> list[str]:
    """Means over seeds first, then a row per seed; the best seed is called so and never alone."""
    keys = [key for key in COLUMNS if all(key in row for row in rows)]
    names = [row_name(row) for row in rows]
    by_method = {
        name: [row for row in rows if row_name(row) == name] for name in dict.fromkeys(names)
    }
    lines = [
        _line([first_heading(rows), "seed", "episodes", *(COLUMNS[key].heading for key in keys)]),
        _line(["---", "---", *["---:"] * (len(keys) + 1)]),
    ]
    for method, seeds in by_method.items():
        if len(seeds) > 1:
            cells = [f"**{_spread(seeds, key)}**" for key in keys]
            lines.append(_line([f"**{method}**", f"mean of {len(seeds)}", "", *cells]))
    for seeds in by_method.values():
        for row in seeds:
            mark = ", best on other episodes" if row["best"] and len(rows) > 1 else ""
            metrics = [_with_interval(row, key) for key in keys]
            cells = [row_name(row), f"{row['seed']}{mark}", row["episodes"], *metrics]
            lines.append(_line(cells))
    spread = any(len(seeds) > 1 for seeds in by_method.values())
    note = NOTE_OVER_SEEDS if spread else ""
    if any("intervals" in row for row in rows):
        note += f"{' ' if note else ''}{NOTE_OVER_EPISODES}"
    single = [method for method, seeds in by_method.items() if len(seeds) == 1]
    if single:
        note += f"{' ' if note else ''}One seed, so no spread: {', '.join(single)}."
    return [*lines, "", *_wrapped(note)]


def shift_table(rows: Sequence[Row]) -> list[str]:
    """A line per row of the hardware shift: the same episodes with something added."""
    keys = [key for key in COLUMNS if all(key in row for row in rows)]
    return [
        _line(["what is added", "episodes", *(COLUMNS[key].heading for key in keys)]),
        _line(["---", *["---:"] * (len(keys) + 1)]),
        *(
            _line([row["name"], row["episodes"], *(_with_interval(row, key) for key in keys)])
            for row in rows
        ),
    ]


def row_name(row: Row) -> str:
    """The row's variant in a sweep, else its method."""
    return str(row.get("variant", row["method"]))


def first_heading(rows: Sequence[Row]) -> str:
    """What ``row_name`` is of these rows."""
    return "variant" if any("variant" in row for row in rows) else "method"


def origin(artifact: Artifact) -> list[str]:
    """Where the numbers come from: command, program, machine, and hashes of all files."""
    program = f"lacoloco {artifact.lacoloco_version}, commit {artifact.git_commit or 'unknown'}"
    policies = [
        f"`{_file(parent.path)}` {parent.sha256[:HASH_LETTERS]}" for parent in artifact.parents
    ]
    rows = [
        f"- command: `{artifact.command}`",
        f"- program: {program}, {artifact.created[:10]}",
        f"- hardware: {hardware(artifact.metadata.get('hardware'))}",
        f"- content hash of the evaluation: {artifact.content_hash[:HASH_LETTERS]}",
        f"- SHA-256 of the policies: {', '.join(policies)}",
    ]
    return [line for row in rows for line in _wrapped(row, "  ")]


def _wrapped(text: str, indent: str = "") -> list[str]:
    """Lines of at most ``WIDTH`` columns, later ones indented; no word is cut."""
    return textwrap.wrap(
        text, WIDTH, subsequent_indent=indent, break_long_words=False, break_on_hyphens=False
    )


def hardware(machine: Mapping[str, Any] | None) -> str:
    """The machine in one line."""
    if not machine:
        return "not recorded"
    where = f"{machine['cores']} cores of {machine.get('processor') or 'an unknown processor'}"
    if machine.get("device") == "cuda":
        where = f"{machine['gpu']} ({machine['gpu_memory_gib']} GiB), {where}"
    versions = [f"{name} {machine[name]}" for name in ("torch", "mujoco") if machine.get(name)]
    return "; ".join([where, *versions])


def _spread(rows: Sequence[Row], key: str) -> str:
    values, column = [row[key] for row in rows], COLUMNS[key]
    mean, deviation = statistics.fmean(values), statistics.stdev(values)
    return f"{_text(mean, column)} +- {_text(deviation, column)} {_bounds(values, column)}"


def _with_interval(row: Row, key: str) -> str:
    """A metric, and its interval where the evaluation has one."""
    found = row.get("intervals", {}).get(key)
    text = _text(row[key], COLUMNS[key])
    return text if found is None else f"{text} {_edges(found, COLUMNS[key])}"


def _bounds(values: Sequence[float], column: Column) -> str:
    from lacoloco.pipelines.evaluation.intervals import over_seeds

    found = over_seeds(values)
    assert found is not None, "a spread has at least two seeds"
    return _edges(found, column)


def _edges(interval: Sequence[float], column: Column) -> str:
    low, high = (_text(edge, column) for edge in interval)
    return f"[{low}, {high}]"


def _text(value: float, column: Column) -> str:
    return f"{value * column.scale:.{column.digits}f}"


def _line(cells: Sequence[Any]) -> str:
    return f"| {' | '.join(map(str, cells))} |"


def _file(path: str) -> str:
    """A policy's name without the folders that only one machine has."""
    return path if path.startswith("published:") else "/".join(Path(path).parts[-4:])
