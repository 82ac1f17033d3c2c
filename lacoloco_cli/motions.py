"""`lacoloco motions`: list, show and draw what is in libraries of motions.

Its further sub-commands have files of their own.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from lacoloco_cli import console, export_motions, import_motions
from lacoloco_cli.motion_libraries import chosen_library, libraries, libraries_of_run
from lacoloco_cli.options import READING
from lacoloco_cli.session import Session, path_text, verb
from lacoloco_cli.written_files import check_output

if TYPE_CHECKING:
    from collections.abc import Sequence

    from lacoloco.datasets.clip import Clips

app = typer.Typer(no_args_is_help=True, help="List, show, draw, import and export motions.")
app.add_typer(import_motions.app)
app.add_typer(export_motions.app)

MOST_ROWS = 60
"""Clips that a person is shown one by one; of a larger library only the skills."""
PICTURE = "motions.png"
Target = Annotated[
    str | None,
    typer.Argument(
        metavar="[RUN|PATH]",
        help="A run, an artifact, its directory, or a published name; default: the run used last.",
    ),
]
GROUP_COLUMNS = {
    "skill": "skill",
    "clips": "clips",
    "seconds": "s",
    "speed_mean_m_s": "speed m/s",
    "speed_max_m_s": "fastest m/s",
    "turning_min_rad_s": "turning from rad/s",
    "turning_max_rad_s": "to rad/s",
    "height_min_m": "height from m",
    "height_max_m": "to m",
}
CLIP_COLUMNS = {
    "name": "clip",
    "skill": "skill",
    "seconds": "s",
    "fps": "fps",
    "speed_mean_m_s": "speed m/s",
    "speed_max_m_s": "fastest m/s",
    "turning_mean_rad_s": "turning rad/s",
    "distance_m": "distance m",
    "height_mean_m": "height m",
    "stance_share": "feet down",
}


@verb(app, "list", shared=READING)
def list_motions(
    session: Session,
    target: Annotated[
        str | None,
        typer.Argument(metavar="[RUN|PATH]", help="The same as of show; default: all runs."),
    ] = None,
) -> None:
    """List the libraries of motions: of a run, or of all."""
    from lacoloco.datasets.clip import load_clips
    from lacoloco.datasets.errors import ArtifactError

    store = session.store
    paths = (
        libraries(store, target)
        if target
        else [p for run in store.runs() for p in libraries_of_run(store, run)]
    )
    rows, broken = [], []
    for path in paths:
        try:  # one bad file must not hide the others
            rows.append(_row(path, load_clips(path)))
        except ArtifactError as error:
            broken.append(str(error))

    def show() -> None:
        columns = ["motions", "robot", "clips", "s", "skills"]
        table = [
            (
                path_text(Path(r["path"])),
                r["robot"],
                r["clips"],
                r["seconds"],
                ", ".join(r["skills"]),
            )
            for r in rows
        ]
        console.print_table(columns, table)
        for problem in broken:
            console.note(f"error: {problem}")

    session.answer({"motions": rows, "problems": broken}, show)
    if broken:
        raise typer.Exit(2)


@verb(app, "show", shared=READING)
def show_motions(session: Session, target: Target = None) -> None:
    """Show clips, seconds, speeds, turning and heights of the newest motions of a run, or of one
    file.
    """
    from lacoloco.datasets.clip import load_clips
    from lacoloco.datasets.motion_statistics import library_statistics

    path = chosen_library(session, target)
    statistics = library_statistics(load_clips(path))

    def show() -> None:
        groups = [*statistics["skills"], statistics["total"]]
        _print(GROUP_COLUMNS, groups)
        clips = statistics["clips"]
        if len(clips) <= MOST_ROWS:
            _print(CLIP_COLUMNS, clips)
        else:
            typer.echo(f"{len(clips):,} clips; --json lists each")

    session.answer({"path": path_text(path), **statistics}, show)


@verb(app, "plot", shared=READING)
def plot_motions(
    session: Session,
    target: Target = None,
    out: Annotated[
        Path | None,
        typer.Option("--out", metavar="FILE", help=f"A .png, .pdf or .svg; default: {PICTURE}."),
    ] = None,
) -> None:
    """Draw speeds, turning, paths, heights and durations of motions as one picture."""
    from lacoloco.datasets.clip import load_clips
    from lacoloco.datasets.motion_statistics import library_statistics
    from lacoloco.pipelines.plots.motions import draw_motions

    path = chosen_library(session, target)
    out = out or Path(PICTURE)
    place = check_output("--out", out, out.suffix.removeprefix("."), session.store.root)
    clips = load_clips(path)
    draw_motions(place, clips, library_statistics(clips), path_text(path))
    payload = {"picture": path_text(out), "motions": path_text(path), "clips": len(clips)}
    session.answer(payload, lambda: typer.echo(payload["picture"]))


def _row(path: Path, clips: Clips) -> dict[str, Any]:
    from lacoloco.datasets.artifact import read_header

    skills = sorted({row.get("skill", "") or "-" for row in clips.table})
    seconds = sum(clip.duration for clip in clips)
    row = {"path": str(path), "robot": read_header(path).robot or None, "clips": len(clips)}
    return {**row, "seconds": seconds, "skills": skills}


def _print(columns: dict[str, str], rows: Sequence[dict[str, Any]]) -> None:
    table = [[row[name] for name in columns] for row in rows]
    console.print_table(list(columns.values()), table)
