"""`lacoloco retarget`: motion capture to motions of the robot."""

from __future__ import annotations

from dataclasses import replace
from typing import Annotated, Any

import typer

from lacoloco_cli import console
from lacoloco_cli.failures import UserError
from lacoloco_cli.options import Robot
from lacoloco_cli.session import Session, path_text, verb

app = typer.Typer()

MODES = ("clip", "paper")
COLUMNS = {
    "name": "clip",
    "frames": "frames",
    "scale": "scale",
    "keypoint_error_mean_m": "error m",
    "keypoint_error_p95_m": "95 % m",
    "foot_skate_mean_m_s": "skate m/s",
    "ground_penetration_max_m": "sunk m",
    "stance_float_max_m": "floats m",
    "contact_agreement": "contacts",
    "joint_limit_hits": "limit hits",
    "joint_speed_hits": "speed hits",
    "joint_acceleration_peak": "rad/s^2",
    "height_error_mean_m": "height off m",
    "speed_error_mean_m_s": "speed off m/s",
    "torque_share_p95": "torque 95 %",
    "solver_failures": "failures",
}
"""The figures of a clip that a table has room for."""
INCOMPLETE = 1
"""Exit code when some files gave clips and others did not."""


@verb(app)
def retarget(
    session: Session,
    sources: Annotated[
        list[str] | None,
        typer.Argument(
            metavar="[FILE|FOLDER|PATTERN]...", help="BVH files; default: the bundled dog."
        ),
    ] = None,
    robot: Robot = "solo12",
    mode: Annotated[
        str | None,
        typer.Option(
            "--mode",
            metavar="clip|paper",
            help="All frames together, feet planted (default), or frame by frame as in the paper.",
        ),
    ] = None,
    scale: Annotated[
        str | None,
        typer.Option(
            "--scale",
            metavar="auto|none|FACTOR",
            help="Fit the animal to the robot, leave it as it is (paper), or fit by a factor.",
        ),
    ] = None,
    up_axis: Annotated[
        str | None, typer.Option("--up-axis", metavar="y|z", help="Axis of the files that is up.")
    ] = None,
    unit: Annotated[
        float | None, typer.Option("--unit", help="Metres per unit of the files; default: 0.01.")
    ] = None,
    licence: Annotated[
        str | None, typer.Option("--licence", help="Licence of the files, kept with the clips.")
    ] = None,
) -> None:
    """Turn motion capture (.bvh) into motions of the robot."""
    from lacoloco.pipelines import retarget as stage

    if mode not in (None, *MODES):
        raise UserError(f"--mode {mode}: use {' or '.join(MODES)}")
    given = {"mode": mode, "scale": scale, "up_axis": up_axis, "unit": unit, "licence": licence}
    given = {key: value for key, value in given.items() if value is not None}
    config = replace(session.config(stage.PRESETS), **given)
    result = stage.run(config, session.context(), robot=robot, sources=sources or ())
    pictures = sorted(result.artifact.parent.glob("reports/*.png"))
    pictures += result.artifact.parent.glob("report.png")
    reports = [path_text(picture) for picture in pictures]
    payload = {"artifact": path_text(result.artifact), **result.metrics, "reports": reports}
    session.answer(payload, lambda: _show(payload))
    if result.metrics["skipped"]:
        raise typer.Exit(INCOMPLETE)


def _show(payload: dict[str, Any]) -> None:
    rows = [[clip[key] for key in COLUMNS] for clip in payload["clips"]]
    console.print_table(list(COLUMNS.values()), rows)
    for entry in payload["skipped"]:
        typer.echo(f"skipped: {entry['error']}")
    typer.echo(f"{payload['frames']:,} frames, {payload['frames_per_second']:.0f} per second")
    for picture in payload["reports"]:
        typer.echo(picture)
    typer.echo(payload["artifact"])
