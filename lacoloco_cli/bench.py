"""`lacoloco bench`: speed of the environments, of the training and of retargeting, next to the raw
engine.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from lacoloco_cli import console
from lacoloco_cli.failures import UserError
from lacoloco_cli.options import DEFAULT_ROBOT, IN_A_RUN, READING, STAGE, Robot
from lacoloco_cli.session import Session, check_device, path_text, verb
from lacoloco_cli.written_files import among_runs

if TYPE_CHECKING:
    from lacoloco.pipelines.benchmarks.throughput import BenchConfig

app = typer.Typer(no_args_is_help=True, help="Measure speed next to the raw engine.")

MEASURING = (*(p for p in STAGE if p.name in ("preset", "overrides", "device")), *READING)
"""Shared options of a measurement: it belongs to no run."""

SEEDED = (*(p for p in STAGE if p.name in ("seed", "device")), *READING)
"""Shared options of a measurement of something that is there already."""


@verb(app, "sim", shared=MEASURING)
def bench_sim(
    session: Session,
    robot: Robot = DEFAULT_ROBOT,
    task: Annotated[
        str, typer.Option("--task", metavar="NAME", help="walk, reach_in_place, imitate or reach.")
    ] = "walk",
) -> None:
    """Environments: physics, rewards, constraints, resets and observations."""
    from lacoloco.pipelines.benchmarks import throughput as bench
    from lacoloco.robots.registry import load_robot

    tasks = load_robot(robot).tasks
    if task not in tasks:
        raise UserError(f"--task {task}: use one of {', '.join(tasks)}")
    config = _config(session)
    _show(session, bench.bench_sim(config, robot=robot, task=task, device=session.device))


@verb(app, "train", shared=MEASURING)
def bench_train(
    session: Session,
    robot: Robot = DEFAULT_ROBOT,
    disc: Annotated[
        str, typer.Option("--disc", metavar="gan|drail", help="Discriminator.")
    ] = "drail",
    cat: Annotated[
        bool, typer.Option("--cat/--no-cat", help="Constraints as terminations.")
    ] = True,
) -> None:
    """The whole low-level training on made-up clips, and where its time goes."""
    from lacoloco.pipelines.benchmarks import throughput as bench

    if disc not in ("gan", "drail"):
        raise UserError(f"--disc {disc}: use gan or drail")
    config = _config(session)
    answer = bench.bench_train(config, robot=robot, disc=disc, cat=cat, device=session.device)
    _show(session, answer)


@verb(app, "contacts", shared=READING)
def bench_contacts(session: Session, robot: Robot = DEFAULT_ROBOT) -> None:
    """How hard a fall hits the feet and how deep they sink, beside a rubber foot; what it costs."""
    from lacoloco.pipelines.sim import contact_bench as bench

    metrics = bench.bench_contacts(robot)

    def show() -> None:
        for name in ("reference", "rows"):
            rows = metrics[name]
            console.print_table(list(rows[0]), [list(row.values()) for row in rows])

    session.answer(metrics, show)


@verb(app, "experts", shared=SEEDED)
def bench_experts(
    session: Session,
    experts: Annotated[
        str | None,
        typer.Argument(metavar="[ARTIFACT]", help="Default: the robot's published experts."),
    ] = None,
    robot: Robot = DEFAULT_ROBOT,
    episodes: Annotated[int, typer.Option(min=1, max=131_072, help="Per expert.")] = 1024,
    seconds: Annotated[float, typer.Option(min=0.1, max=600.0, help="Of an episode.")] = 10.0,
) -> None:
    """Experts: falls and errors with real torque limits and the pushes of their tasks."""
    from lacoloco.datasets import published
    from lacoloco.pipelines.benchmarks import experts as bench

    path = published.resolve(experts or f"{robot}-experts")
    check_device(session.device)
    metrics = bench.bench_experts(
        path, episodes=episodes, seconds=seconds, seed=session.seed, device=session.device
    )
    _show(session, {"experts": path_text(path), "episodes": episodes, **metrics})


@verb(app, "motions", shared=READING)
def bench_motions(
    session: Session,
    robot: Robot = DEFAULT_ROBOT,
    hours: Annotated[
        float, typer.Option("--hours", min=0.01, max=1000.0, help="Of motion, in clips of 10 s.")
    ] = 40.0,
) -> None:
    """Loading a library of motions: time, memory, and what a draw from it takes."""
    from lacoloco.pipelines.benchmarks import motion_loading as bench

    _show(session, bench.bench_motions(robot, hours))


@verb(app, "retarget", shared=READING)
def bench_retarget(
    session: Session,
    sources: Annotated[
        list[str] | None,
        typer.Argument(metavar="[FILE|FOLDER|PATTERN]...", help="Default: the bundled dog."),
    ] = None,
    robot: Robot = DEFAULT_ROBOT,
) -> None:
    """Retargeting on one core: speed and quality of both modes, and if they suffice."""
    from lacoloco.datasets.samples import DOG_BVH
    from lacoloco.pipelines.benchmarks import retargeting as bench
    from lacoloco.pipelines.retargeting.mocap.sources import find_recordings

    files, skipped = bench.usable(robot, find_recordings(sources or [DOG_BVH]))
    if not files:
        raise UserError("; ".join(skipped))
    for line in skipped:
        console.note(f"skipped: {line}")
    speed = bench.bench_retarget(robot, files)
    rows = bench.compare_modes(robot, files)
    starts = bench.other_starts(robot, files)
    verdicts = bench.verdicts(rows, {**speed, **starts})
    metrics = {"robot": robot, **speed, **starts}

    def show() -> None:
        console.print_table(["metric", "value"], list(metrics.items()))
        console.print_table(list(rows[0]), [list(row.values()) for row in rows])
        console.print_table(list(verdicts[0]), [list(row.values()) for row in verdicts])

    session.answer({**metrics, "skipped": skipped, "files": rows, "verdicts": verdicts}, show)


@verb(app, "gpu", shared=IN_A_RUN)
def bench_gpu(
    session: Session,
    worlds: Annotated[int, typer.Option("--worlds", min=1, help="Parallel worlds.")] = 4096,
    seconds: Annotated[
        float, typer.Option("--seconds", min=0.0, help="About so long per measurement.")
    ] = 10.0,
    minutes: Annotated[
        float, typer.Option("--minutes", min=0.0, help="For trainings afterwards.")
    ] = 0.0,
    preset: Annotated[str, typer.Option("--preset", help="Preset of the trainings.")] = "gpu",
    device: Annotated[
        str | None,
        typer.Option("--device", metavar="cpu|cuda", help="Default: cuda where there is one."),
    ] = None,
    out: Annotated[
        Path | None,
        typer.Option("--out", help="A folder for copies of the metrics and the policies."),
    ] = None,
) -> None:
    """Everything about a GPU in one go: parity, the table of metrics, then trainings.

    Metrics are on disk after each row, and trainings write checkpoints. So it may be interrupted at
    any moment, and the same command goes on with the trainings.
    """
    from lacoloco.pipelines.benchmarks.gpu import METRICS, GpuBenchConfig
    from lacoloco.pipelines.benchmarks.gpu import bench_gpu as measure
    from lacoloco.pipelines.train_low import PRESETS

    if preset not in PRESETS:
        raise UserError(f"--preset {preset}: use {', '.join(PRESETS)}")
    session.run = session.run or "bench-gpu"
    session.device = device or _best_device()
    if out is not None:
        check_folder("--out", out, session.store.root)
    answer = measure(GpuBenchConfig(worlds, seconds, minutes, preset), session.context(), out)
    report = session.store.directory(session.run_name) / METRICS
    session.answer({"metrics": path_text(report), **answer}, lambda: _show_gpu(answer, report))


def check_folder(option: str, folder: Path, runs: Path) -> None:
    """Make a folder for copies, or take one that holds nothing but earlier ones.

    Raises:
        UserError: It lies among the runs, holds something else, or cannot be made.
    """
    from lacoloco.pipelines.benchmarks.gpu import METRICS, METRICS_BEFORE

    if among_runs(folder.resolve(), runs):
        raise UserError(f"{option} {folder}: runs hold what stages write; name another folder")
    try:
        folder.mkdir(parents=True, exist_ok=True)
        ours = any((folder / name).is_file() for name in (METRICS, METRICS_BEFORE))
        taken = any(folder.iterdir()) and not ours
    except OSError as error:
        raise UserError(f"{option} {folder}: {error.strerror}; name another folder") from error
    if taken:
        raise UserError(f"{option} {folder}: holds other files; name a new folder")


def _best_device() -> str:
    import torch

    return "cuda" if torch.cuda.is_available() else "cpu"


def _show_gpu(answer: Mapping[str, Any], report: Path) -> None:
    machine = answer["machine"]
    typer.echo(f"on {machine['gpu'] or 'the CPU'}, commit {answer['commit'] or 'unknown'}")
    columns = ("name", "engine", "worlds", "steps_per_second", "ratio_to_engine", "must", "aim")
    rows = [[row[column] for column in columns] for row in answer["rows"]]
    console.print_table(list(columns), rows)
    for row in answer["trainings"]:
        error = row.get("evaluation", {}).get("ee_error_mean_m")
        came = row["status"] if error is None else f"error {100 * error:.1f} cm"
        spent = console.duration_text(row["wall_seconds"])
        typer.echo(f"{row['experiment']} {row['method']}: {came} after {spent}; run {row['run']}")
    typer.echo(f"metrics: {path_text(report)}")


def _config(session: Session) -> BenchConfig:
    from lacoloco.pipelines.benchmarks.throughput import PRESETS

    check_device(session.device)
    return session.config(PRESETS)


def _show(session: Session, metrics: Mapping[str, Any]) -> None:
    def show() -> None:
        facts = [(name, value) for name, value in metrics.items() if name != "shares"]
        console.print_table(["metric", "value"], facts)
        if "shares" in metrics:
            shares = [(name, 100.0 * share) for name, share in metrics["shares"].items()]
            console.print_table(["part", "% of the time"], shares)

    session.answer(metrics, show)
