"""`lacoloco motions export`: clips as files of other programs."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from lacoloco_cli.failures import UserError
from lacoloco_cli.motion_libraries import chosen_library
from lacoloco_cli.options import READING
from lacoloco_cli.session import Session, path_text, verb
from lacoloco_cli.written_files import among_runs

app = typer.Typer()

MOST_FPS = 1000


@verb(app, "export", shared=READING)
def export_motions(
    session: Session,
    target: Annotated[
        str | None,
        typer.Argument(
            metavar="[RUN|PATH]",
            help="A run, an artifact, its directory, or a published name; default: the run used"
            " last.",
        ),
    ] = None,
    to: Annotated[
        Path, typer.Option("--to", metavar="FOLDER", help="Where the files go, one per clip.")
    ] = Path("motions"),
    form: Annotated[
        str,
        typer.Option(
            "--format",
            metavar="npz|csv|lafan1",
            help="npz of mjlab and BeyondMimic, CSV with a header, or as the retargeted LAFAN1.",
        ),
    ] = "npz",
    clip: Annotated[
        list[str] | None,
        typer.Option("--clip", metavar="NAME", help="Only this clip; may be repeated."),
    ] = None,
    fps: Annotated[
        float | None,
        typer.Option("--fps", help="Another rate; default: that of each clip. lafan1 has 30."),
    ] = None,
) -> None:
    """Write clips as .npz of mjlab and BeyondMimic, or as CSV."""
    from lacoloco.datasets.artifact import read_header
    from lacoloco.datasets.atomic_write import write_file
    from lacoloco.datasets.clip import load_clips
    from lacoloco.pipelines.foreign_motions.writing import FORMATS, encoded
    from lacoloco.pipelines.robot import robot_of

    if form not in FORMATS:
        raise UserError(f"--format {form}: use {', '.join(FORMATS)}")
    if fps is not None and not 1 <= fps <= MOST_FPS:
        raise UserError(f"--fps {fps:g}: use a number from 1 to {MOST_FPS:,}")
    if fps is not None and form == "lafan1":
        raise UserError(f"--fps {fps:g}: lafan1 has 30 frames per second; leave it out")
    if to.exists() and not to.is_dir():
        raise UserError(f"--to {to}: is a file; name a folder")
    path = chosen_library(session, target)
    clips = [one for one in load_clips(path) if not clip or one.name in clip]
    unknown = sorted(set(clip or ()) - {one.name for one in clips})
    if unknown:
        raise UserError(f"--clip {unknown[0]}: not in {path_text(path)}; `motions show` lists them")
    spec = robot_of(read_header(path), session.progress.say)
    if clips[0].joint_names != spec.joint_names:
        raise UserError(f"{path_text(path)}: its joints are not those of {spec.name}")
    if among_runs(to.absolute(), session.store.root):
        raise UserError(f"--to {to}: runs hold what stages write; name a folder outside of them")
    files = [to / f"{name}{FORMATS[form]}" for name in file_names([one.name for one in clips])]
    for file in files:
        if file.exists():
            raise UserError(f"{file}: exists already and is kept; name another folder with --to")
    session.progress.start("export", len(files))
    for count, (one, file) in enumerate(zip(clips, files, strict=True), 1):
        write_file(file, encoded(spec, one.resample(fps) if fps else one, form))
        session.progress.advance(count)
    written = [path_text(file) for file in files]
    payload = {"motions": path_text(path), "format": form, "files": written}
    session.answer(payload, lambda: typer.echo("\n".join(written)))


def file_names(names: list[str]) -> list[str]:
    """Names of clips as names of files, each once."""
    plain = ["".join(c if c.isalnum() or c in "-_.+" else "_" for c in name) for name in names]
    plain = [name.lstrip(".") or "clip" for name in plain]
    repeated = {name for name in plain if plain.count(name) > 1}
    return [f"{name}_{index}" if name in repeated else name for index, name in enumerate(plain)]
