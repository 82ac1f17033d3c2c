"""The options that every verb shares, each said once."""

from __future__ import annotations

from collections.abc import Callable
from inspect import Parameter
from pathlib import Path
from typing import Annotated, Any

import typer

PANEL = "Shared options"


def _option(*names: str, help: str, **extra: Any) -> Any:
    return typer.Option(*names, help=help, rich_help_panel=PANEL, **extra)


Run = Annotated[
    str | None,
    _option("--run", metavar="NAME", help="Name of the run; default: the one used last."),
]
Preset = Annotated[
    str,
    _option(
        "--preset",
        metavar="NAME",
        help="Size of the work: smoke, laptop, gpu or paper; paper-method: without what is ours.",
    ),
]
Set = Annotated[
    list[str] | None,
    _option("--set", metavar="KEY=VALUE", help="Change one config field; may be repeated."),
]
ShowConfig = Annotated[
    bool,
    _option("--show-config", help="Only list every key of --set: value, unit, meaning and range."),
]
Seed = Annotated[int, _option("--seed", min=0, max=2**31 - 1, help="Seed of everything random.")]
Device = Annotated[
    str,
    _option("--device", metavar="cpu|cuda", help="Where physics and learning run."),
]
Resume = Annotated[
    bool,
    _option(
        "--resume",
        help="Go on with the newest unfinished version, or with --resume VERSION, as it was begun:"
        " the same settings, seed, robot and inputs. What differs is refused.",
    ),
]
ResumeVersion = Annotated[str, typer.Option("--version-to-resume", hidden=True)]
NoResume = Annotated[bool, typer.Option("--resume", hidden=True)]
AsJson = Annotated[bool, _option("--json", help="Print exactly one JSON object on stdout.")]
Quiet = Annotated[bool, _option("--quiet", "-q", help="Show no progress.")]
Debug = Annotated[bool, _option("--debug", help="Show the traceback of an error.")]

DEFAULT_ROBOT = "solo12"
"""The robot of the paper, which a verb takes where none is named."""

# own options of several verbs
Robot = Annotated[
    str,
    typer.Option(
        "--robot",
        metavar="NAME|PATH",
        help="One of `lacoloco robots list`, or a folder with robot.toml and its MJCF.",
    ),
]
Checkpoint = Annotated[
    Path | None,
    typer.Option(
        "--checkpoint",
        metavar="FILE",
        help="Go on from a checkpoint, perhaps of another machine, with its settings and seed.",
    ),
]
Observe = Annotated[
    str | None,
    typer.Option(
        "--observe",
        metavar="full|onboard",
        help="What the policy sees: all, or IMU, joints and an odometry only (no motion capture);"
        " default: full, for a high level as its low level.",
    ),
]
RunNamed = Annotated[
    str | None, typer.Argument(metavar="[RUN]", help="Default: the run used last.")
]
MotionsToCompare = Annotated[
    list[Path] | None,
    typer.Option(
        "--motions", help="Motions to compare with; default: those that the policy comes from."
    ),
]
Port = Annotated[
    int,
    typer.Option(
        "--port", min=0, max=65535, help="Of the page on this machine; 0: any that is free."
    ),
]
Seeds = Annotated[
    int,
    typer.Option("--seeds", min=1, max=1000, help="How many seeds, counted up from --seed."),
]


def _parameter(name: str, annotation: Any, default: Any) -> Parameter:
    return Parameter(name, Parameter.KEYWORD_ONLY, default=default, annotation=annotation)


READING = (
    _parameter("as_json", AsJson, False),
    _parameter("quiet", Quiet, False),
    _parameter("debug", Debug, False),
)
"""Shared options of a command that only reads, such as `runs list`."""

IN_A_RUN = (_parameter("run", Run, None), *READING)
"""Shared options of a command that reads or writes one run but has no config."""

STAGE = (
    _parameter("run", Run, None),
    _parameter("preset", Preset, "laptop"),
    _parameter("overrides", Set, None),
    _parameter("show_config", ShowConfig, False),
    _parameter("seed", Seed, 0),
    _parameter("device", Device, "cpu"),
    _parameter("resume", Resume, False),
    _parameter("version", ResumeVersion, ""),
    *READING,
)
"""Shared options of a command that runs a stage."""

AT_ONCE = tuple(
    parameter.replace(annotation=NoResume) if parameter.name == "resume" else parameter
    for parameter in STAGE
)
"""The same for a stage that keeps nothing to go on with; `--resume` is refused with the reason."""

Body = Callable[..., None]
