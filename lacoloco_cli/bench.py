"""`lacoloco bench`: speed of the environments, of the training and of retargeting, next to the raw engine."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Annotated, Any

import typer

from lacoloco_cli import console
from lacoloco_cli.failures import UserError
from lacoloco_cli.options import READING, STAGE, Robot
from lacoloco_cli.session import Session, check_device, verb

if TYPE_CHECKING:
    from lacoloco.pipelines.bench import BenchConfig

app = typer.Typer(no_args_is_help=True, help="Measure speed next to the raw engine.")

MEASURING = (*(p for p in STAGE if p.name in ("preset", "overrides", "device")), *READING)
"""Shared options of a measurement: it belongs to no run."""


@verb(app, "sim", shared=MEASURING)
def bench_sim(
    session: Session,
    robot: Robot = "solo12",
    task: Annotated[
        str, typer.Option("--task", metavar="NAME", help="walk, reach_in_place, imitate or reach.")
    ] = "walk",
) -> None:
    """Environments: physics, rewards, constraints, resets and observations."""
    from lacoloco.pipelines import bench
    from lacoloco.pipelines.sim.tasks import TASKS

    if task not in TASKS:
        raise UserError(f"--task {task}: use one of {', '.join(TASKS)}")
    config = _config(session)
    _show(session, bench.bench_sim(config, robot=robot, task=task, device=session.device))


@verb(app, "train", shared=MEASURING)
def bench_train(
    session: Session,
    robot: Robot = "solo12",
    disc: Annotated[
        str, typer.Option("--disc", metavar="gan|drail", help="Discriminator.")
    ] = "drail",
    cat: Annotated[
        bool, typer.Option("--cat/--no-cat", help="Constraints as terminations.")
    ] = True,
) -> None:
    """The whole low-level training on made-up clips, and where its time goes."""
    from lacoloco.pipelines import bench

    if disc not in ("gan", "drail"):
        raise UserError(f"--disc {disc}: use gan or drail")
    config = _config(session)
    answer = bench.bench_train(config, robot=robot, disc=disc, cat=cat, device=session.device)
    _show(session, answer)


@verb(app, "retarget", shared=READING)
def bench_retarget(
    session: Session,
    sources: Annotated[
        list[str] | None,
        typer.Argument(metavar="[FILE|FOLDER|PATTERN]...", help="Default: the bundled dog."),
    ] = None,
    robot: Robot = "solo12",
) -> None:
    """Retargeting on one core: speed, what both modes make of the files, what they must show."""
    from lacoloco.datasets.samples import DOG_BVH
    from lacoloco.pipelines.retargeting import bench
    from lacoloco.pipelines.retargeting.sources import find_recordings

    files, skipped = bench.usable(robot, find_recordings(sources or [DOG_BVH]))
    for line in skipped:
        console.note(f"skipped: {line}")
    if not files:
        raise UserError("none of these files can be retargeted")
    speed = bench.bench_retarget(robot, files)
    rows = bench.compare_modes(robot, files)
    starts = bench.other_starts(robot, files)
    verdicts = bench.verdicts(rows, {**speed, **starts})
    figures = {"robot": robot, **speed, **starts}

    def show() -> None:
        console.print_table(["figure", "value"], list(figures.items()))
        console.print_table(list(rows[0]), [list(row.values()) for row in rows])
        console.print_table(list(verdicts[0]), [list(row.values()) for row in verdicts])

    session.answer({**figures, "skipped": skipped, "files": rows, "verdicts": verdicts}, show)


def _config(session: Session) -> BenchConfig:
    from lacoloco.pipelines.bench import PRESETS

    check_device(session.device)
    return session.config(PRESETS)


def _show(session: Session, figures: Mapping[str, Any]) -> None:
    def show() -> None:
        facts = [(name, value) for name, value in figures.items() if name != "shares"]
        console.print_table(["figure", "value"], facts)
        if "shares" in figures:
            shares = [(name, 100.0 * share) for name, share in figures["shares"].items()]
            console.print_table(["part", "% of the time"], shares)

    session.answer(figures, show)
