"""`lacoloco doctor`: is everything there, and which engine would be used."""

from __future__ import annotations

import os
import platform
import tempfile
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass, replace
from importlib import import_module, metadata
from importlib.util import find_spec
from pathlib import Path
from typing import Annotated, Any

import typer

from lacoloco_cli import console
from lacoloco_cli.failures import USER_MISTAKE, one_line
from lacoloco_cli.options import DEFAULT_ROBOT, READING
from lacoloco_cli.session import Session, verb

app = typer.Typer()

MODULES = {"pin": "pinocchio", "rsl-rl-lib": "rsl_rl", "mujoco": "mujoco.batch"}
"""Distribution -> module that shows it works, where the names differ."""

DRIVERS = ("gpu", "driver", "cuda", "torch", "warp-lang", "mujoco-warp")
"""What a GPU run depends on, of all that is known about the machine."""

MUJOCO_FIX = "pip install --force-reinstall --no-deps mujoco mujoco-core mujoco-studio"


@dataclass(frozen=True)
class Check:
    """One line of the report."""

    name: str
    ok: bool
    found: str
    fix: str = ""


@verb(app, shared=READING)
def doctor(
    session: Session,
    bench: Annotated[
        bool, typer.Option("--bench", help="Measure that engine for ten seconds.")
    ] = False,
) -> None:
    """Check the installation and say which engine would be used, and why."""
    from lacoloco.datasets.hardware import describe_machine

    checks = [check_python(), *check_requirements(), check_mujoco(), check_solver()]
    checks += [check_runs(session.store.root), check_simulation()]
    engine, reason = choose_engine()
    healthy = all(check.ok for check in checks)
    machine = describe_machine()
    payload: dict[str, Any] = {
        "ok": healthy,
        "engine": engine,
        "reason": reason,
        "machine": machine,
        "checks": [asdict(check) for check in checks],
    }
    if bench:
        payload["throughput"] = throughput("cuda" if machine["gpu"] else "cpu")

    def show() -> None:
        rows = [("ok" if c.ok else "FAILS", c.name, c.found, c.fix) for c in checks]
        console.print_table(["", "check", "found", "what to do"], rows)
        typer.echo(f"engine: {engine} ({reason})")
        typer.echo(", ".join(f"{name} {machine[name] or 'none'}" for name in DRIVERS))
        for name, rate in payload.get("throughput", {}).items():
            typer.echo(f"{name}: {console.rate_text(rate)} control steps/s")

    session.answer(payload, show)
    if not healthy:
        raise typer.Exit(USER_MISTAKE)


def check_python() -> Check:
    """Is this Python one that the project is made for?"""
    from packaging.specifiers import SpecifierSet

    wanted = metadata.metadata("lacoloco")["Requires-Python"]
    found = platform.python_version()
    ok = SpecifierSet(wanted).contains(found)
    return Check("python", ok, found, "" if ok else f"use Python {wanted}")


def check_requirements() -> Iterator[Check]:
    """Is every dependency there, importable, and of a version that the project is made for?"""
    from packaging.requirements import Requirement

    for text in metadata.requires("lacoloco") or []:
        requirement = Requirement(text)
        if requirement.marker is None or requirement.marker.evaluate({"extra": ""}):
            yield _check_requirement(requirement.name, requirement.specifier.contains, text)


def _check_requirement(name: str, fits: Callable[[str], bool], wanted: str) -> Check:
    fix = f"pip install '{wanted}'"
    try:
        found = metadata.version(name)
        import_module(MODULES.get(name, name.replace("-", "_")))
    except metadata.PackageNotFoundError:
        return Check(name, False, "missing", fix)
    except Exception as error:  # a broken wheel may raise anything
        reason = one_line(f"{found}, but importing it fails: {error}")
        return Check(name, False, reason, MUJOCO_FIX if name == "mujoco" else fix)
    return Check(name, fits(found), found, "" if fits(found) else fix)


def check_mujoco() -> Check:
    """Do MuJoCo's parts belong together?

    4.0 split the package in three; pip's upgrade of an older one in place removes files that the
    parts have just installed.
    """
    versions = {}
    for part in ("mujoco", "mujoco-core", "mujoco-studio"):
        try:
            versions[part] = metadata.version(part)
        except metadata.PackageNotFoundError:
            versions[part] = "missing"
    whole = len(set(versions.values())) == 1 and "missing" not in versions.values()
    found = ", ".join(f"{part} {version}" for part, version in versions.items())
    return Check("mujoco parts", whole, found, "" if whole else MUJOCO_FIX)


def check_solver() -> Check:
    """Does casadi bring Ipopt, which retargeting solves with?"""
    try:
        import casadi

        there = bool(casadi.has_nlpsol("ipopt"))
    except ImportError:
        there = False
    fix = "" if there else "pip install --force-reinstall casadi"
    return Check("ipopt", there, "in casadi" if there else "missing", fix)


def check_simulation() -> Check:
    """Does the CPU engine run, and how fast about? `lacoloco bench sim` measures it properly."""
    fix = "run `lacoloco robots check` and see which part fails"
    try:
        from lacoloco.pipelines.benchmarks.throughput import BenchConfig, bench_sim

        metrics = bench_sim(BenchConfig(worlds=256, steps=10, rounds=3), robot=DEFAULT_ROBOT)
    except Exception as error:  # whatever a broken installation raises is what is asked for
        return Check("simulation", False, one_line(f"{type(error).__name__}: {error}"), fix)
    rate, ratio = metrics["steps_per_second"], metrics["ratio_to_engine"]
    found = f"about {console.rate_text(rate)} control steps/s, {ratio:.2f} of the bare engine"
    return Check("simulation", True, found)


def check_runs(root: Path) -> Check:
    """Can results be written?"""
    place = root.absolute()
    while not place.exists():
        place = place.parent
    try:
        with tempfile.NamedTemporaryFile(dir=place):
            pass
    except OSError as error:
        fix = f"make {place} writable or set LACOLOCO_RUNS to another folder"
        return Check("runs folder", False, f"{root}: {error.strerror}", fix)
    return Check("runs folder", True, str(root))


def throughput(device: str) -> dict[str, float]:
    """Control steps per second of the environment loop and of training, in about ten seconds."""
    from lacoloco.pipelines.benchmarks.throughput import PRESETS, bench_sim, bench_train

    preset = PRESETS["gpu" if device == "cuda" else "laptop"]()
    config = replace(preset, rounds=1000, seconds=5.0)
    return {
        "environment loop": bench_sim(config, robot=DEFAULT_ROBOT, device=device)[
            "steps_per_second"
        ],
        "low-level training": bench_train(config, robot=DEFAULT_ROBOT, device=device)[
            "steps_per_second"
        ],
    }


def choose_engine() -> tuple[str, str]:
    """Name the fastest engine that this machine can use, and the reason."""
    from lacoloco.datasets.hardware import cores
    from lacoloco.pipelines.sim.engines import ENGINE_VARIABLE

    cpu = f"mujoco.batch on the CPU, {cores()} threads"
    if os.environ.get(ENGINE_VARIABLE) == "warp":
        cpu = "MuJoCo Warp on the CPU, slow, because LACOLOCO_PHYSICS=warp"
    if find_spec("mujoco_warp") is None:
        return cpu, "MuJoCo Warp is not installed; pip install 'lacoloco[gpu]' for --device cuda"
    try:
        import torch

        device = torch.cuda.get_device_name() if torch.cuda.is_available() else None
    except ImportError:
        device = None
    if device is None:
        return cpu, "torch finds no CUDA device"
    return f"MuJoCo Warp on {device}", "with --device cuda; without it, " + cpu
