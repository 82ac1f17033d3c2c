"""A run as one HTML page: its stages, results, curves, figures, playbacks and where all came from.

The page holds everything that it shows. It needs no network, and no other file.
"""

from __future__ import annotations

import base64
from collections.abc import Iterator, Mapping, Sequence
from html import escape
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from lacoloco.datasets.artifact import Header, read_header
from lacoloco.datasets.errors import ArtifactError
from lacoloco.datasets.lineage import Ancestor, lineage
from lacoloco.datasets.store import RunStore
from lacoloco.pipelines.errors import StageError
from lacoloco.pipelines.plots.curves import plot_run

ORDER = ("generate", "retarget", "track", "train-low", "train-high", "eval", "switching", "export")
"""Of the stages on the page, that of the chain; others follow by name."""
CURVES = "curves.png"
"""What `runs plot` writes into a run."""
SHOWN_METRICS = 12
"""As many of a stage's metrics as fit in a glance."""


def build_run_page(store: RunStore, run: str, shown: Mapping[str, Sequence[str]]) -> str:
    """Make the page.

    Args:
        store: The runs.
        run: Which of them.
        shown: Stage -> the metrics of it that a person wants to see; others show the first few.

    Returns:
        HTML.

    Raises:
        StageError: The run has nothing to show.
    """
    stages = sorted(store.stages(run), key=lambda one: (_rank(one), one))
    versions = {stage: store.all(run, stage) for stage in stages}
    curves = _curves(store, run)
    if not any(versions.values()) and not curves:
        known = ", ".join(store.runs()) or "none"
        raise StageError(f"run '{run}' has nothing to show; runs: {known}")
    headers, problems = _headers(versions)
    newest = [paths[-1] for paths in versions.values() if paths and paths[-1] in headers]
    parts = [
        _problems(problems),
        _section("Stages", _stages(store, run, versions, headers)),
        _section("Results", "".join(_results(headers[path], shown) for path in newest)),
        _section("Curves", curves),
        _section("Figures", "".join(_figures(store.directory(run), versions))),
        _section("Playback", "".join(_playbacks(versions))),
        _section("Lineage", "".join(_lineages(newest, headers))),
    ]
    template = Path(__file__).with_name("gallery.html").read_text(encoding="utf-8")
    robots = sorted({header.robot for header in headers.values() if header.robot})
    page = {
        "{{title}}": escape(f"run {run}" + (f" ({', '.join(robots)})" if robots else "")),
        "{{about}}": escape(_about(headers)),
        "{{sections}}": "\n".join(part for part in parts if part),
    }
    for mark, text in page.items():
        template = template.replace(mark, text)
    return template


def _rank(stage: str) -> int:
    return ORDER.index(stage) if stage in ORDER else len(ORDER)


def _headers(versions: Mapping[str, Sequence[Path]]) -> tuple[dict[Path, Header], list[str]]:
    """What every artifact says of itself, and which do not: one bad file hides no other."""
    headers, problems = {}, []
    for path in (path for paths in versions.values() for path in paths):
        try:
            headers[path] = read_header(path)
        except ArtifactError as error:
            problems.append(str(error))
    return headers, problems


def _about(headers: Mapping[Path, Header]) -> str:
    times = sorted(header.created for header in headers.values())
    if not times:
        return "nothing of it is complete yet"
    commits = ", ".join(sorted({header.git_commit[:10] for header in headers.values()} - {""}))
    return f"made from {times[0]} to {times[-1]}" + (f", commits {commits}" if commits else "")


def _section(title: str, content: str) -> str:
    return f"<section><h2>{title}</h2>\n{content}</section>" if content else ""


def _problems(problems: Sequence[str]) -> str:
    return "".join(f'<p class="bad">{escape(one)}</p>' for one in problems)


def _table(columns: Sequence[str], rows: Sequence[Sequence[Any]]) -> str:
    head = "".join(f"<th>{escape(column.replace('_', ' '))}</th>" for column in columns)
    body = "".join(f"<tr>{''.join(map(_cell, row))}</tr>" for row in rows)
    return f'<div class="wide"><table><tr>{head}</tr>{body}</table></div>\n'


def _cell(value: Any) -> str:
    number = isinstance(value, (int, float)) and not isinstance(value, bool)
    return f"<td{' class=number' if number else ''}>{escape(_text(value))}</td>"


def _text(value: Any) -> str:
    return f"{value:.4g}" if isinstance(value, float) else "" if value is None else str(value)


def _stages(
    store: RunStore,
    run: str,
    versions: Mapping[str, Sequence[Path]],
    headers: Mapping[Path, Header],
) -> str:
    """A row per version, the unfinished ones among them, with the command that made it."""
    rows: list[list[Any]] = []
    for stage, paths in versions.items():
        for path in paths:
            header = headers.get(path)
            known = [header.seed, header.created, header.command] if header else [None, None, ""]
            state = "complete" if header else "damaged"
            rows.append([stage, path.parent.name, state, *known])
        for partial in store.partials(run, stage):
            rows.append([stage, partial.final.name, "unfinished", None, None, partial.label])
    return _table(("stage", "version", "state", "seed", "created", "command"), rows)


def _results(header: Header, shown: Mapping[str, Sequence[str]]) -> str:
    """The rows of an evaluation, or the metrics of another stage that are plain numbers."""
    name = f"<h3>{escape('/'.join(header.path.parts[-3:-1]))}</h3>\n"
    evaluated = header.metadata.get("rows")
    if evaluated:
        keys = [key for key in evaluated[0] if all(_plain(row.get(key)) for row in evaluated)]
        return name + _table(keys, [[row.get(key) for key in keys] for row in evaluated])
    metrics = header.metadata.get("metrics") or {}
    wanted = shown.get(header.path.parts[-3], metrics)
    rows = [[key, metrics[key]] for key in wanted if _plain(metrics.get(key))]
    return name + _table(("metric", "value"), rows[:SHOWN_METRICS]) if rows else ""


def _plain(value: Any) -> bool:
    return isinstance(value, (str, int, float))


def _curves(store: RunStore, run: str) -> str:
    """The picture of all trainings; "" where there are none."""
    with TemporaryDirectory() as folder:
        picture = Path(folder) / "curves.png"
        try:
            plot_run(store, run, picture)
        except StageError:  # a run of motions alone has no trainings
            return ""
        return _figure(picture, "all trainings")


def _figures(folder: Path, versions: Mapping[str, Sequence[Path]]) -> Iterator[str]:
    """The pictures beside the newest version of every stage, and those of the run, such as that of
    `runs coverage`; the curves are on the page anyway.
    """
    for picture in sorted(folder.glob("*.png")):
        if picture.name != CURVES:
            yield _figure(picture, picture.name)
    for stage, paths in versions.items():
        for picture in sorted(paths[-1].parent.rglob("*.png")) if paths else ():
            place = picture.relative_to(paths[-1].parents[1])
            yield _figure(picture, f"{stage}/{place.as_posix()}")


def _figure(picture: Path, caption: str) -> str:
    content = base64.b64encode(picture.read_bytes()).decode()
    image = f'<img alt="{escape(caption)}" src="data:image/png;base64,{content}">'
    return f"<figure>{image}<figcaption>{escape(caption)}</figcaption></figure>\n"


def _playbacks(versions: Mapping[str, Sequence[Path]]) -> Iterator[str]:
    """The newest page of `play`, packed, behind a button."""
    for path in versions.get("play", ())[-1:]:
        page = path.with_name("playback.html")
        if page.is_file():
            packed, name = base64.b64encode(page.read_bytes()).decode(), f"play-{path.parent.name}"
            yield f'<button data-page="{name}">watch {escape(name)}</button>\n'
            yield f'<script type="text/plain" id="{name}">{packed}</script>\n'


def _lineages(newest: Sequence[Path], headers: Mapping[Path, Header]) -> Iterator[str]:
    """Of every chain's end, all that it was made of."""
    used = {parent.locate(path).resolve() for path in newest for parent in headers[path].parents}
    for path in newest:
        if path.resolve() not in used:
            lines = "\n".join(_ancestor(one) for one in lineage(path))
            title = escape("/".join(path.parts[-3:-1]))
            yield f"<details open><summary>{title}</summary><pre>{lines}</pre></details>\n"


def _ancestor(ancestor: Ancestor) -> str:
    said = ancestor.header.command if ancestor.header else f"sha256 {ancestor.sha256[:16]}"
    mark = "" if ancestor.state == "ok" else f'  <b class="bad">{ancestor.state}</b>'
    return f"{'  ' * ancestor.depth}{escape(str(ancestor.path))}  {escape(said)}{mark}"
