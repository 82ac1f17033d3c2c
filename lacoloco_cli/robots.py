"""`lacoloco robots`: list, show, check and import robots."""

from __future__ import annotations

from dataclasses import asdict, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from lacoloco_cli import console
from lacoloco_cli.failures import USER_MISTAKE, UserError
from lacoloco_cli.options import READING
from lacoloco_cli.session import Session, verb
from lacoloco_cli.written_files import check_ending, check_output

if TYPE_CHECKING:
    from lacoloco.robots.check import CheckReport
    from lacoloco.robots.spec import RobotSpec
    from lacoloco.robots.stance import Stance

app = typer.Typer(no_args_is_help=True, help="List, show, check and import robots.")

_ONE = "One of `lacoloco robots list`, or a folder with robot.toml and its MJCF"
Name = Annotated[str | None, typer.Argument(metavar="NAME|PATH", help=f"{_ONE}.")]
OptionalName = Annotated[
    str | None,
    typer.Argument(metavar="[NAME|PATH]", help=f"{_ONE}; default: all in the list."),
]
RobotOption = Annotated[
    str | None,
    typer.Option("--robot", metavar="NAME|PATH", help="The same, as other verbs say it."),
]


@verb(app, "list", shared=READING)
def list_robots(session: Session) -> None:
    """List the robots with their size and weight."""
    from lacoloco.robots.registry import load_robot, robot_folders, robot_origins

    folders = robot_folders()
    robots = [
        {**_summary(load_robot(name)), "origin": origin, "folder": str(folders[name])}
        for name, origin in robot_origins().items()
    ]

    def show() -> None:
        columns = ["robot", "joints", "mass kg", "weight N", "height m", "end effector", "model"]
        columns.append("comes from")
        rows = [
            (
                robot["name"],
                robot["joints"],
                robot["total_mass"],
                robot["weight"],
                robot["default_height"],
                robot["end_effector"],
                robot["model_hash"][:12],
                robot["origin"],
            )
            for robot in robots
        ]
        console.print_table(columns, rows)

    session.answer({"robots": robots}, show)


@verb(app, "show", shared=READING)
def show_robot(session: Session, name: Name = None, robot: RobotOption = None) -> None:
    """Show all numbers of one robot."""
    from lacoloco.robots.registry import load_robot

    wanted = _wanted(name, robot)
    if wanted is None:
        raise UserError("which robot? name one of `lacoloco robots list`, or a folder")
    spec = load_robot(wanted)
    joints = _joint_rows(spec)
    payload = {
        **_summary(spec),
        "mjcf": str(spec.mjcf),
        "feet": spec.feet,
        "foot_radius": spec.foot_radius(),
        "foot_force_limit": spec.foot_force_limit(),
        "fall_bodies": spec.fall_bodies,
        "undesired_contact_bodies": spec.undesired_contact_bodies,
        "self_collision": spec.self_collision,
        "action_scale": spec.action_scale,
        "walk_action_scale": spec.walk_action_scale,
        "keypoints": spec.keypoints,
        "knee_frames": spec.knee_frames,
        "joints": joints,
    }

    def show() -> None:
        for key, value in payload.items():
            if key != "joints":
                typer.echo(f"{key}: {_line(value)}")
        columns = ["joint", "default", "lower", "upper", "kp", "kd", "torque", "training", "speed"]
        rows = [list(joint.values()) for joint in joints]
        console.print_table(columns, rows, title="rad, N.m/rad, N.m.s/rad, N.m, rad/s")

    session.answer(payload, show)


@verb(app, "check", shared=READING)
def check_robots(
    session: Session,
    name: OptionalName = None,
    robot: RobotOption = None,
    figure: Annotated[
        Path | None,
        typer.Option(
            "--figure",
            metavar="FILE.png",
            help="Draw one robot after it stood for 10 s: its looks, and the shapes that touch.",
        ),
    ] = None,
) -> None:
    """Check numbers and tasks of robots, how they stand, and that both engines agree on them."""
    from lacoloco.pipelines.sim.robot_tasks import check_tasks
    from lacoloco.robots.registry import load_robot, robot_names

    wanted = _wanted(name, robot)
    if figure is not None and wanted is None:
        raise UserError("--figure draws one robot; name it")
    place = None if figure is None else _figure_place(session, figure)
    names = robot_names() if wanted is None else (wanted,)
    specs = [load_robot(one) for one in names]
    for spec in specs:
        check_tasks(spec)
    reports = [_checked(spec) for spec in specs]
    failures = [check for report in reports for check in report.failures()]

    def show() -> None:
        for report in reports:
            if report.passed:
                _show_report(report)
        if wanted is not None and not failures:
            typer.echo(f"next: lacoloco generate --robot {wanted}")

    answer = {"passed": not failures, "robots": [_report(report) for report in reports]}
    if failures:
        others = f" (and {len(failures) - 1} more; see --json)" if len(failures) > 1 else ""
        error = failures[0].problem + others
        answer |= {"error": error, "exit_code": USER_MISTAKE}
        console.note(f"error: {error}")
    if place is not None:
        _draw(specs[0], reports[0], place)
        answer["figure"] = str(figure)
        console.note(f"drawn: {figure}")
    session.answer(answer, show)
    if failures:
        raise typer.Exit(USER_MISTAKE)


@verb(app, "import", shared=READING)
def import_one(
    session: Session,
    file: Annotated[Path, typer.Argument(metavar="FILE", help="MJCF or URDF, as published.")],
    name: Annotated[str, typer.Option("--name", help="What the robot is called from now on.")],
    to: Annotated[
        Path | None,
        typer.Option(
            "--to",
            metavar="DIR",
            help="Folder for the robot's folder; default: ~/.config/lacoloco/robots.",
        ),
    ] = None,
    fix: Annotated[
        list[str] | None,
        typer.Option("--fix", metavar="JOINT", help="Weld joints, by name or pattern."),
    ] = None,
) -> None:
    """Make robot.toml and MJCF from an MJCF or URDF, and ask for what it does not say."""
    from lacoloco.robots.importing.importer import import_robot
    from lacoloco.robots.registry import OWN

    robots = Path(OWN if to is None else to).expanduser()
    imported = import_robot(file, name, robots, fixed=fix or ())
    questions = [asdict(question) for question in imported.questions]
    answer = {"folder": str(imported.folder), "notes": imported.notes, "questions": questions}

    def show() -> None:
        for line in imported.notes:
            typer.echo(line)
        if questions:
            rows = [(one["key"], one["what"], one["assumed"] or "-") for one in questions]
            columns = {"fill in": 40, "what": None, "until then": 24}
            console.print_wrapped(columns, rows)
        wanted = name if to is None else imported.folder
        check = f"lacoloco robots check {wanted} --figure {name}.png"
        typer.echo(f"made {imported.folder}; next: {check}")

    session.answer(answer, show)


def _checked(spec: RobotSpec) -> CheckReport:
    """The report on a robot's numbers and, where these are right, on a moment of every task."""
    from lacoloco.pipelines.sim.robot_trial import trial_checks
    from lacoloco.robots.check import check_robot

    report = check_robot(spec)
    if not report.passed:
        return report
    return replace(report, checks=(*report.checks, *trial_checks(spec)))


def _figure_place(session: Session, figure: Path) -> Path:
    """Where the picture goes, before any work.

    Raises:
        UserError: Another kind of file, a place that cannot be taken, or no OpenGL here.
    """
    from lacoloco.pipelines.viewing.opengl import check_gl

    kind = check_ending("--figure", figure, ("png",))
    place = check_output("--figure", figure, kind, session.store.root)
    check_gl()
    return place


def _draw(spec: RobotSpec, report: CheckReport, place: Path) -> None:
    """Draw a robot as it stood at the end, or in its default pose: where it was not tried, or has a
    gait because it does not stand by itself.
    """
    from lacoloco.datasets.atomic_write import write_file
    from lacoloco.pipelines.viewing.robot_picture import draw_robot

    stood = report.stance if spec.gait is None else None
    qpos = spec.default_qpos() if stood is None else stood.qpos
    write_file(place, draw_robot(spec, qpos), replace=True)


def _wanted(name: str | None, robot: str | None) -> str | None:
    """The robot that was asked for, whichever way; None for none.

    Raises:
        UserError: Two different ones.
    """
    if name is not None and robot is not None and name != robot:
        raise UserError(f"--robot {robot}: {name!r} is asked for, too; name one robot")
    return robot if name is None else name


def _summary(spec: RobotSpec) -> dict[str, Any]:
    end, offset = spec.end_effector.body, spec.end_effector.offset
    shift = f" + ({', '.join(f'{x:g}' for x in offset)}) m" if any(offset) else ""
    return {
        "name": spec.name,
        "joints": spec.num_joints,
        "total_mass": spec.total_mass(),
        "weight": spec.weight(),
        "default_height": spec.default_height(),
        "end_effector": end + shift,
        "model_hash": spec.model_hash(),
    }


def _joint_rows(spec: RobotSpec) -> list[dict[str, Any]]:
    lower, upper = spec.joint_limits()
    effort = spec.effort_limits()
    return [
        {
            "joint": joint,
            "default": spec.default_joint_pos[i],
            "lower": float(lower[i]),
            "upper": float(upper[i]),
            "stiffness": spec.stiffness[i],
            "damping": spec.damping[i],
            "effort_limit": float(effort[i]),
            "training_effort_limit": spec.training_effort_limits[i],
            "velocity_limit": spec.velocity_limits[i],
        }
        for i, joint in enumerate(spec.joint_names)
    ]


def _line(value: Any) -> str:
    if isinstance(value, dict):
        return ", ".join(f"{key} -> {item}" for key, item in value.items()) or "-"
    if isinstance(value, tuple):
        return ", ".join(str(item) for item in value) or "-"
    return console.cell_text(value)


def _report(report: CheckReport) -> dict[str, Any]:
    return {
        "robot": report.robot,
        "passed": report.passed,
        "total_mass": report.total_mass,
        "model_hash": report.model_hash,
        "stance": None if report.stance is None else _stance(report.stance),
        "checks": [
            {
                "name": check.name,
                "passed": check.passed,
                "value": check.value,
                "limit": check.limit,
                "unit": check.unit,
                "place": check.place,
                "detail": "" if check.passed else check.detail,
            }
            for check in report.checks
        ],
    }


def _stance(stance: Stance) -> dict[str, Any]:
    return {key: value for key, value in asdict(stance).items() if key != "qpos"}


def _show_report(report: CheckReport) -> None:
    rows = [(check.name, check.value, check.limit, check.unit) for check in report.checks]
    title = f"{report.robot}: ok ({report.total_mass:.6f} kg)"
    console.print_table(["check", "value", "limit", "unit"], rows, title=title)
    if report.stance is not None:
        typer.echo(f"{report.robot} {report.stance.said}")
