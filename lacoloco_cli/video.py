"""`lacoloco play --video`: one episode or clip as a film, drawn without a browser or a screen."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from lacoloco_cli.failures import UserError
from lacoloco_cli.session import Session
from lacoloco_cli.written_files import check_ending, check_output

if TYPE_CHECKING:
    from lacoloco.pipelines.viewing.camera import Look

PANEL = "Films"
ENDINGS = ("mp4", "gif")


@dataclass(frozen=True)
class VideoOptions:
    """Options of a film; what is not given is left to the kind of file."""

    video: Annotated[
        Path | None,
        typer.Option(
            "--video",
            "--gif",
            metavar="FILE",
            help="Instead of a page, one episode or clip as an .mp4 (pip install 'lacoloco[video]')"
            " or as a .gif of less than 3 MB; --set seconds=6 for a shorter one.",
            rich_help_panel=PANEL,
        ),
    ] = None
    speed: Annotated[
        float | None,
        typer.Option(
            "--speed",
            metavar="FACTOR",
            help="0.25 is slow motion, 2 twice as fast.",
            rich_help_panel=PANEL,
        ),
    ] = None
    camera: Annotated[
        str | None,
        typer.Option(
            "--camera",
            metavar="target|follow|fixed",
            help="It goes along and keeps robot and target in the picture (default), goes along"
            " with the robot alone, or stands still and sees the whole way.",
            rich_help_panel=PANEL,
        ),
    ] = None
    azimuth: Annotated[
        float | None,
        typer.Option(
            "--azimuth",
            metavar="DEGREES",
            help="Where the camera looks: 0 along x, 90 along y.",
            rich_help_panel=PANEL,
        ),
    ] = None
    elevation: Annotated[
        float | None,
        typer.Option(
            "--elevation",
            metavar="DEGREES",
            help="How steeply: 0 level, -89 from above.",
            rich_help_panel=PANEL,
        ),
    ] = None
    size: Annotated[
        str | None,
        typer.Option(
            "--size", metavar="WIDTHxHEIGHT", help="Pixels, e.g. 1280x720.", rich_help_panel=PANEL
        ),
    ] = None

    def given(self) -> dict[str, Any]:
        """The options that were given, without `video`, by name."""
        return {
            name: value
            for name, value in vars(self).items()
            if value is not None and name != "video"
        }

    def applied_to(self, look: Look) -> Look:
        """A look with what was given.

        Raises:
            UserError: A size that is none.
            ConfigError: A value that its field does not allow; the message names the option.
        """
        from lacoloco.datasets.config_values import check_value, fields_of

        given = self.given()
        if size := given.pop("size", None):
            given |= _pixels(size)
        hints = dict(fields_of(type(look)))
        for name, value in given.items():
            called = f"--size {self.size}" if name in ("width", "height") else f"--{name} {value}"
            check_value(value, hints[name], called)
        return replace(look, **given)


def _pixels(size: str) -> dict[str, int]:
    read = re.fullmatch(r"(\d{1,5})x(\d{1,5})", size)
    if read is None or int(read[1]) % 2 or int(read[2]) % 2:
        raise UserError(f"--size {size}: use WIDTHxHEIGHT in even numbers, e.g. 1280x720")
    return {"width": int(read[1]), "height": int(read[2])}


def draw_video(
    session: Session, source: Path, latents: str, options: VideoOptions, names: Sequence[str]
) -> None:
    """Draw the first of what a page would show; what needs checking is checked first.

    Args:
        session: The call.
        source: Artifact of motions, of a policy or of a playback.
        latents: Of the stage's config.
        options: Where the film goes, and how it looks.
        names: At most one clip.
    """
    video = options.video
    assert video is not None
    kind = check_ending("--video", video, ENDINGS)
    place = check_output("--video", video, kind, session.store.root)
    look = checked_look(options, kind)
    from lacoloco.datasets.artifact import read_artifact
    from lacoloco.datasets.atomic_write import write_file
    from lacoloco.pipelines import play as stage
    from lacoloco.pipelines.robot import robot_of
    from lacoloco.pipelines.viewing import render

    config = replace(session.config(stage.PRESETS), clips=1, episodes=1, latents=latents)
    artifact = read_artifact(source)
    recorded = stage.record(artifact, config, session.seed, names, session.progress)
    shown = recorded[0].until(config.seconds)
    draw = render.render_mp4 if kind == "mp4" else render.render_gif
    content = draw(robot_of(artifact), shown, look, session.progress)
    write_file(place, content, replace=True)
    answer: dict[str, Any] = {"video": str(video), "bytes": len(content), "robot": artifact.robot}
    answer |= {"recording": shown.name, "seconds": round(shown.duration, 2)}
    session.answer(answer, lambda: typer.echo(answer["video"]))


def checked_look(options: VideoOptions, kind: str) -> Look:
    """How a film of a kind looks, once it is known that it can be drawn here.

    Raises:
        UserError: A size that is none.
        ConfigError: A value that its field does not allow.
        StageError: There is no OpenGL here, or nothing that writes an .mp4.
    """
    from lacoloco.pipelines.viewing.mp4 import check_mp4
    from lacoloco.pipelines.viewing.opengl import check_gl

    if kind == "mp4":
        check_mp4()
    check_gl()  # before anything imports MuJoCo
    from lacoloco.pipelines.viewing.render import GIF_LOOK, MP4_LOOK

    return options.applied_to(MP4_LOOK if kind == "mp4" else GIF_LOOK)
