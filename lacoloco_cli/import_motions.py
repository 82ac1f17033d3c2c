"""`lacoloco motions import`: motions of other programs as clips of a robot."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Annotated, Any

import typer

from lacoloco_cli import console
from lacoloco_cli.option_group import with_options
from lacoloco_cli.options import AT_ONCE, DEFAULT_ROBOT, Robot
from lacoloco_cli.session import Session, path_text, verb

if TYPE_CHECKING:
    from lacoloco.pipelines.foreign_motions.config import ImportConfig

app = typer.Typer()

INCOMPLETE = 1
"""Exit code when some files gave clips and others did not."""
COLUMNS = {
    "name": "clip",
    "kind": "file",
    "seconds": "s",
    "source_fps": "from fps",
    "quaternion": "quaternion",
    "lifted_m": "lifted m",
    "stance_share": "feet down",
}


@dataclass(frozen=True)
class ImportOptions:
    """Options that change the config: each is named like a field of `ImportConfig`.

    An option that is not given is None.
    """

    joints: Annotated[
        str | None,
        typer.Option(
            "--joints",
            metavar="model|breadth-first|legs|NAMES|FILE",
            help="Order of the joints: that of the MJCF; level by level (Isaac Lab); front right,"
            " front left, rear right, rear left; or their names. Default: as the file says.",
        ),
    ] = None
    quaternion: Annotated[
        str | None,
        typer.Option(
            "--quaternion",
            metavar="wxyz|xyzw",
            help="Order of the orientation's columns; default: as its format has it, or the only"
            " one in which the base is upright.",
        ),
    ] = None
    source_fps: Annotated[
        float | None,
        typer.Option("--source-fps", help="Frames per second; overrides what the files say."),
    ] = None
    fps: Annotated[
        float | None, typer.Option("--fps", help="Frames per second of the clips; default: 50.")
    ] = None
    keep_height: Annotated[
        bool | None,
        typer.Option(
            "--keep-height", help="Do not put the feet on the ground.", show_default=False
        ),
    ] = None
    skill: Annotated[
        str | None, typer.Option("--skill", help="Group of the clips; default: imported.")
    ] = None
    licence: Annotated[
        str | None, typer.Option("--licence", help="Licence of the files, kept with the clips.")
    ] = None

    def applied_to(self, config: ImportConfig) -> ImportConfig:
        """The config with what was given.

        Raises:
            ConfigError: A value that its field does not allow; the message names the option.
        """
        from lacoloco.datasets.config_values import check_value, fields_of

        given = {key: value for key, value in vars(self).items() if value is not None}
        hints = dict(fields_of(type(config)))
        for name, value in given.items():
            check_value(value, hints[name], f"--{name.replace('_', '-')} {value}")
        return replace(config, **given)


@verb(app, "import", shared=AT_ONCE)
@with_options(ImportOptions)
def import_motions(
    session: Session,
    options: ImportOptions,
    sources: Annotated[
        list[str],
        typer.Argument(
            metavar="FILE|FOLDER...", help="Files that end in .npz, .csv, .txt, .json or .pkl."
        ),
    ],
    robot: Robot = DEFAULT_ROBOT,
) -> None:
    """Import motions of the robot from GMR, MimicKit, mjlab, BeyondMimic, AMP, LAFAN1 or a CSV.

    Pickles are read without executing them.
    """
    from lacoloco.pipelines import import_motions as stage

    config = options.applied_to(session.config(stage.PRESETS))
    result = stage.run(config, session.context(), robot=robot, sources=sources)
    payload = {"artifact": path_text(result.artifact), **result.metrics}
    session.answer(payload, lambda: _show(payload), then="track")
    if result.metrics["skipped"]:
        raise typer.Exit(INCOMPLETE)


def _show(payload: dict[str, Any]) -> None:
    rows = [[clip[key] for key in COLUMNS] for clip in payload["clips"]]
    console.print_table(list(COLUMNS.values()), rows)
    typer.echo(payload["artifact"])
