"""`lacoloco run`: a whole experiment, from motions to a policy to watch."""

from __future__ import annotations

import difflib
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from lacoloco_cli import console
from lacoloco_cli.compared import Compared
from lacoloco_cli.failures import UserError
from lacoloco_cli.options import PANEL, STAGE, Seeds
from lacoloco_cli.session import Session, path_text, verb
from lacoloco_cli.sweep import Sweep, run_sweep

if TYPE_CHECKING:
    from lacoloco.pipelines.chains.chain_stages import Outcome

app = typer.Typer()

NAMES = (
    "quickstart",
    "solo12-synthetic",
    "solo12-dog",
    "solo12-dog-reach",
    "go2-synthetic",
    "h1-human",
    "h1-synthetic",
    "table-1",
)
"""The experiments and the paper's table, said here as well: help imports none of them."""

Set = Annotated[
    list[str] | None,
    typer.Option(
        "--set",
        metavar="STAGE.KEY=VALUE",
        help="Change a config field of one stage, e.g. train-low.ppo.gamma=0.97; may be repeated.",
        rich_help_panel=PANEL,
    ),
]
# an experiment has no config of its own: its settings name a stage first
SHARED = tuple(
    parameter.replace(annotation=Set) if parameter.name == "overrides" else parameter
    for parameter in STAGE
    if parameter.name != "show_config"
)

Methods = Annotated[
    str | None,
    typer.Option(
        "--methods",
        metavar="all|NAME,...",
        help="Several methods, each seed of each in a job of its own: gan-cat, drail, ...",
    ),
]
SweepFile = Annotated[
    Path | None,
    typer.Option(
        "--sweep",
        metavar="FILE",
        help="Several variants, a table each in a TOML file: [NAME] set = ['STAGE.KEY=VALUE'].",
    ),
]
Executor = Annotated[
    str | None,
    typer.Option(
        "--executor", metavar="local|slurm", help="Where the jobs run.", show_default="local"
    ),
]
Jobs = Annotated[
    int | None,
    typer.Option("--jobs", min=1, help="Jobs at the same time; default: 1, on Slurm all."),
]
Slurm = Annotated[
    list[str] | None,
    typer.Option("--slurm", metavar="KEY=VALUE", help="Parameter of Slurm; may be repeated."),
]
Status = Annotated[
    bool, typer.Option("--status", help="Only show how far the jobs' trainings are.")
]
OwnRobot = Annotated[
    str | None,
    typer.Option(
        "--robot",
        metavar="NAME|PATH",
        help="Another robot than the experiment's: one of `lacoloco robots list`, or its folder.",
    ),
]
FromScratch = Annotated[
    bool,
    typer.Option(
        "--from-scratch",
        help="Train the low level, too, instead of using a published one (quickstart); "
        "--preset paper-method always does.",
    ),
]


@verb(app, shared=SHARED, names_run="name", several_stages=True)
def run(
    session: Session,
    name: Annotated[
        str | None,
        typer.Argument(
            metavar="NAME",
            help=f"One of {', '.join(NAMES)}.",
            autocompletion=lambda incomplete: [n for n in NAMES if n.startswith(incomplete)],
        ),
    ] = None,
    disc: Annotated[
        str, typer.Option("--disc", metavar="gan|drail", help="Discriminator of the low level.")
    ] = "drail",
    cat: Annotated[
        bool, typer.Option("--cat/--no-cat", help="Constraints as terminations.")
    ] = True,
    mocap: Annotated[
        list[Path] | None,
        typer.Option("--mocap", help="A .bvh to retarget instead of the sample; may be repeated."),
    ] = None,
    seeds: Seeds = 1,
    robot: OwnRobot = None,
    methods: Methods = None,
    sweep: SweepFile = None,
    executor: Executor = None,
    jobs: Jobs = None,
    slurm: Slurm = None,
    status: Status = False,
    from_scratch: FromScratch = False,
) -> None:
    """Run an experiment from nothing: motions, both levels, evaluation, ONNX, pages to watch.

    With --methods, --sweep or --executor: motions, then both levels of every variant and seed, each
    in a job of its own, then the evaluation of all. Given again, it does what is missing.
    `table-1 --robot solo12|h1` is the paper's: all methods, fresh episodes, seeds from 10 upwards.

    With --resume, and always with several, a stage is kept that is complete with the same
    settings, seed, robot and inputs. Where they differ, it runs again as a new version, and one
    line says what differs. --status shows the newest of each method and seed, whatever its
    settings.
    """
    from lacoloco.pipelines.chains import chain, experiments
    from lacoloco.pipelines.chains.sweep import Asked
    from lacoloco.pipelines.chains.variants import TABLE_1_SEED
    from lacoloco.pipelines.retargeting.mocap.sources import find_recordings

    name = known_name(name, NAMES)
    method = f"{disc}-cat" if cat else disc
    if method not in experiments.METHODS:
        raise UserError(f"--disc {disc}: use gan or drail")
    preset = session.preset or "laptop"
    asked = Compared(session.overrides, preset, method, methods, robot, sweep)
    compared = asked.variants(name)
    find_recordings(mocap or [])
    if name == "table-1" or methods or sweep or executor or status:
        if name == "table-1" and not first_seed_typed(session.arguments):
            session.seed = TABLE_1_SEED
        many = Sweep(
            name=name,
            variants=compared,
            asked=Asked(preset, None if name == "table-1" else robot, tuple(mocap or ())),
            seeds=seeds,
            executor=executor or "local",
            jobs=jobs,
            slurm=slurm or [],
        )
        run_sweep(session, many, status=status)
        return
    context = session.context()
    session.remember()
    outcomes = chain.run(
        name,
        context,
        preset=preset,
        method=method,
        seeds=seeds,
        mocap=mocap or [],
        robot=robot,
        from_scratch=from_scratch,
        settings=compared[0].settings,
    )
    _answer(session, name, outcomes)


def first_seed_typed(arguments: Sequence[str]) -> bool:
    """Whether the command line has `--seed`."""
    return any(one.partition("=")[0] == "--seed" for one in arguments)


def _answer(session: Session, name: str, outcomes: Sequence[Outcome]) -> None:
    """Say what each stage of an experiment left."""
    stages: list[dict[str, Any]] = [
        {
            "stage": outcome.stage,
            "seconds": outcome.seconds,
            "summary": outcome.summary,
            "artifact": path_text(outcome.artifact),
        }
        for outcome in outcomes
    ]
    seconds = sum(outcome.seconds for outcome in outcomes)

    def show() -> None:
        rows = [
            (row["stage"], console.duration_text(row["seconds"]), row["summary"], row["artifact"])
            for row in stages
        ]
        rows.append(("total", console.duration_text(seconds), "", ""))
        console.print_table(["stage", "time", "what came out", "where it is"], rows)

    answer = {"experiment": name, "run": session.run_name, "seconds": seconds, "stages": stages}
    session.answer({"artifact": stages[-1]["artifact"], **answer}, show, then="play")


def known_name(name: str | None, known: Iterable[str]) -> str:
    """Return the name of an experiment that exists.

    Raises:
        UserError: The message lists the known ones and the nearest.
    """
    known = list(known)
    if name is None:
        raise UserError(f"which experiment? use one of {', '.join(known)}")
    if name not in known:
        near = difflib.get_close_matches(name, known, n=1)
        hint = f"did you mean {near[0]!r}? " if near else ""
        raise UserError(f"experiment {name!r} is not known; {hint}use one of {', '.join(known)}")
    return name
