"""`lacoloco retarget`: motion capture to motions of the robot."""

from __future__ import annotations

import os
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Annotated, Any

import typer

from lacoloco_cli import console
from lacoloco_cli.failures import UserError
from lacoloco_cli.option_group import with_options
from lacoloco_cli.options import DEFAULT_ROBOT, Robot
from lacoloco_cli.session import Session, path_text, verb

if TYPE_CHECKING:
    from lacoloco.pipelines.retargeting.config import RetargetConfig

app = typer.Typer()

MODES = ("clip", "paper")
COLUMNS = {
    "name": "clip",
    "frames": "frames",
    "scale": "scale",
    "keypoint_error_mean_m": "error m",
    "keypoint_error_p95_m": "95 % m",
    "keypoint_error_max_m": "max m",
    "foot_skate_mean_m_s": "skate m/s",
    "ground_penetration_max_m": "sunk m",
    "stance_share": "stands",
    "body_penetration_max_m": "body sunk m",
    "self_penetration_max_m": "self m",
    "stance_float_max_m": "floats m",
    "contact_agreement": "contacts",
    "joint_limit_hits": "limit hits",
    "joint_speed_hits": "speed hits",
    "joint_acceleration_peak": "rad/s^2",
    "height_error_mean_m": "height off m",
    "speed_error_mean_m_s": "speed off m/s",
    "torque_share_p95": "torque 95 %",
    "solver_failures": "failures",
    "times_real_time": "x real time",
}
"""The metrics of a clip that the table shows, and the head of each column."""
INCOMPLETE = 1
"""Exit code when some files gave clips and others did not."""


@dataclass(frozen=True)
class RetargetOptions:
    """Options that change the config: each is named like a field of `RetargetConfig`.

    An option that is not given is None, and leaves the preset as it is.
    """

    mode: Annotated[
        str | None,
        typer.Option(
            "--mode",
            metavar="clip|paper",
            help="All frames together, feet planted (default), or frame by frame as in the paper.",
        ),
    ] = None
    select: Annotated[
        str | None,
        typer.Option(
            "--select",
            metavar="NAME|FILE",
            help="Only the files and parts listed, e.g. paper-dogs.",
        ),
    ] = None
    trim: Annotated[
        str | None,
        typer.Option(
            "--trim", metavar="START:END", help="Part of each file: frames (120:600) or 2s:10s."
        ),
    ] = None
    fps: Annotated[float | None, typer.Option("--fps", help="Frames per second of the clips.")] = (
        None
    )
    mirror: Annotated[
        bool | None, typer.Option("--mirror", help="Retarget the mirror image.", show_default=False)
    ] = None
    bend: Annotated[
        float | None,
        typer.Option(
            "--bend",
            metavar="RAD/M",
            help="Bend the animal's course to the left by so much per metre; negative: right.",
        ),
    ] = None
    augment: Annotated[
        bool | None,
        typer.Option(
            "--augment",
            help="Six clips per file: also its mirror image, and both on bent courses.",
            show_default=False,
        ),
    ] = None
    scale: Annotated[
        str | None,
        typer.Option(
            "--scale",
            metavar="auto|none|FACTOR",
            help="Fit the animal to the robot, leave it as it is (paper), or fit by a factor.",
        ),
    ] = None
    up_axis: Annotated[
        str | None,
        typer.Option("--up-axis", metavar="[-]x|y|z", help="Axis of the files that is up."),
    ] = None
    unit: Annotated[
        float | None, typer.Option("--unit", help="Metres per unit of the files, e.g. 0.01.")
    ] = None
    source_fps: Annotated[
        float | None,
        typer.Option("--source-fps", help="Frames per second; overrides what the files say."),
    ] = None
    swap_sides: Annotated[
        bool | None,
        typer.Option(
            "--swap-sides", help="Exchange left and right in the files.", show_default=False
        ),
    ] = None
    map: Annotated[
        str | None,
        typer.Option(
            "--map", metavar="FILE", help="Your own map from joints of the files to the robot."
        ),
    ] = None
    licence: Annotated[
        str | None, typer.Option("--licence", help="Licence of the files, kept with the clips.")
    ] = None

    def applied_to(self, config: RetargetConfig) -> RetargetConfig:
        """The config with what was given.

        Raises:
            UserError: Unknown mode.
            ConfigError: A value that its field does not allow; the message names the option.
        """
        from lacoloco.datasets.config_values import check_value, fields_of

        if self.mode not in (None, *MODES):
            raise UserError(f"--mode {self.mode}: use {' or '.join(MODES)}")
        given = {key: value for key, value in vars(self).items() if value is not None}
        for name in ("unit", "source_fps", "fps"):  # zero in the config: nothing was given
            if given.get(name) == 0:
                option = f"--{name.replace('_', '-')}"
                raise UserError(f"{option} 0: use a number above 0, or leave the option out")
        hints = dict(fields_of(type(config)))
        for name, value in given.items():
            check_value(value, hints[name], f"--{name.replace('_', '-')} {value}")
        return replace(config, **given)


@verb(app)
@with_options(RetargetOptions)
def retarget(
    session: Session,
    options: RetargetOptions,
    sources: Annotated[
        list[str] | None,
        typer.Argument(
            metavar="[FILE|FOLDER|PATTERN]...",
            help="BVH files; default: the bundled dog or person.",
        ),
    ] = None,
    robot: Robot = DEFAULT_ROBOT,
    maps: Annotated[
        bool, typer.Option("--maps", help="List the maps and selections that come with lacoloco.")
    ] = False,
    jobs: Annotated[
        int, typer.Option("--jobs", "-j", min=0, help="Processes; 0: one per core.")
    ] = 0,
    force: Annotated[
        bool, typer.Option("--force", help="Also make the clips that the run has already.")
    ] = False,
) -> None:
    """Turn motion capture (.bvh) into motions of the robot."""
    from lacoloco.pipelines import retarget as stage

    if maps:
        return list_maps(session)
    config = options.applied_to(session.config(stage.PRESETS))
    result = stage.run(
        config, session.context(), robot=robot, sources=sources or (), jobs=jobs, force=force
    )
    folder = result.artifact.parent
    pictures = sorted([*folder.glob("report.png"), *folder.glob("reports/**/*.png")])
    reports = [path_text(picture) for picture in pictures]
    payload = {"artifact": path_text(result.artifact), **result.metrics, "reports": reports}
    session.answer(payload, lambda: _show(payload))
    if result.metrics["skipped"] or result.metrics["absent"]:
        raise typer.Exit(INCOMPLETE)


def list_maps(session: Session) -> None:
    """Show which skeletons are known, and which selections of datasets."""
    from lacoloco.pipelines.retargeting.mocap.selection import load_selection, shipped_selections
    from lacoloco.pipelines.retargeting.mocap.skeleton_maps import shipped_maps

    maps = [
        {
            "name": skeleton.name,
            "robot": skeleton.robot,
            "up_axis": skeleton.up_axis,
            "unit": skeleton.unit,
            "scale": skeleton.scale,
            "joints": ", ".join(skeleton.keypoints),
            "about": skeleton.about,
        }
        for skeleton in shipped_maps()
    ]
    known = [load_selection(name) for name in shipped_selections()]
    selections = [{"name": s.name, "clips": len(s.trims), "about": s.about} for s in known]

    def show() -> None:
        for rows, column in ((maps, "map"), (selections, "selection")):
            columns = [column, *list(rows[0])[1:]]
            console.print_table(columns, [list(row.values()) for row in rows])

    session.answer({"maps": maps, "selections": selections}, show)


def _show(payload: dict[str, Any]) -> None:
    rows = [[clip[key] for key in COLUMNS] for clip in payload["clips"]]
    console.print_table(list(COLUMNS.values()), rows)
    for clip in payload["clips"]:
        for note in clip["notes"]:
            typer.echo(f"{clip['name']}: {note}")
    for entry in payload["skipped"]:
        typer.echo(f"skipped: {entry['error']}")
    if payload["absent"]:
        typer.echo(f"selected, but not there: {', '.join(payload['absent'])}")
    typer.echo(
        f"{len(payload['clips'])} clips ({payload['kept']} were there), {len(payload['skipped'])}"
        f" skipped, {len(payload['absent'])} absent; {payload['frames']:,} frames,"
        f" {payload['frames_per_second']:.0f} per second and core"
    )
    folder = "reports" if len(payload["reports"]) > 1 else "report.png"
    if payload["reports"]:
        typer.echo(os.path.join(os.path.dirname(payload["artifact"]), folder))
    typer.echo(payload["artifact"])
