"""What gets installed, and which way imports point."""

from __future__ import annotations

import ast
import os
import shutil
import subprocess
import sys
import sysconfig
import tomllib
import zipfile
from pathlib import Path

import pytest

CHECKOUT = Path(__file__).parents[1]
ROOMS = ("pipelines", "robots", "datasets")
BUILT = (".ci", "build", "dist", "runs", ".venv", "__pycache__")
TRAINING = ("generate", "train_low", "train_high", "evaluate", "benchmarks.throughput")


def module_files():
    """Every Python file that gets installed, relative to the checkout."""
    folders = [CHECKOUT / name for name in (*ROOMS, "lacoloco_cli")]
    files = [file.relative_to(CHECKOUT) for folder in folders for file in folder.rglob("*.py")]
    assert len(files) > 20
    return sorted(files)


def imports_of(file, *, top_level_only=False):
    """Yield the absolute name of everything a file imports, also inside functions."""
    tree = ast.parse((CHECKOUT / file).read_text())
    nodes = tree.body if top_level_only else list(ast.walk(tree))
    for node in nodes:
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{file}:{node.lineno}: imports are absolute"
            yield from (f"{node.module}.{alias.name}" for alias in node.names)


def imported(file, *prefixes, **how):
    """Which imports of a file lie under one of the prefixes."""
    return [
        name
        for name in imports_of(file, **how)
        if any(name == prefix or name.startswith(f"{prefix}.") for prefix in prefixes)
    ]


def pyproject():
    return tomllib.loads((CHECKOUT / "pyproject.toml").read_text())


def test_every_folder_is_installed():
    """Those of data, too: setuptools takes them for forgotten packages and says so in every
    installation.
    """
    rooms = [CHECKOUT / name for name in (*ROOMS, "lacoloco_cli")]
    files = [
        file.relative_to(CHECKOUT) for room in rooms for file in room.rglob("*.*") if file.is_file()
    ]
    folders = {file.parent for file in files if "__pycache__" not in file.parts}
    expected = {
        str(folder).replace("/", ".") if folder.parts[0] == "lacoloco_cli" else name
        for folder in folders
        for name in ["lacoloco." + ".".join(folder.parts)]
    }
    assert expected == set(pyproject()["tool"]["setuptools"]["packages"])


@pytest.mark.parametrize("room", ROOMS)
def test_no_room_is_a_package_by_itself(room):
    # with an __init__.py it would shadow the PyPI package of the same name
    assert (CHECKOUT / room).is_dir()
    assert not (CHECKOUT / room / "__init__.py").exists()


def test_no_folder_of_tests_is_a_package():
    assert list((CHECKOUT / "tests").rglob("__init__.py")) == []


@pytest.mark.parametrize("folder", [*ROOMS, "lacoloco_cli", "tests"])
def test_every_room_says_what_it_is(folder):
    assert len((CHECKOUT / folder / "README.md").read_text()) > 200


@pytest.mark.parametrize("file", module_files(), ids=str)
def test_imports_point_downhill(file):
    above = {
        "robots": ("lacoloco.datasets", "lacoloco.pipelines", "lacoloco_cli"),
        "datasets": ("lacoloco.robots", "lacoloco.pipelines", "lacoloco_cli"),
        "pipelines": ("lacoloco_cli",),
        "lacoloco_cli": (),
    }[file.parts[0]]
    assert imported(file, *above, *ROOMS) == []


@pytest.mark.parametrize("file", module_files(), ids=str)
def test_learning_and_physics_stay_in_their_rooms(file):
    folder = file.parent.as_posix()
    if folder == "pipelines/learn":
        reach = ("lacoloco.pipelines.sim", "lacoloco.datasets.artifact", "h5py", "mujoco")
        assert imported(file, *reach) == []
    physics = ("pipelines/sim", "pipelines/sim/disturbances")
    if file.parts[0] == "pipelines" and folder not in physics:
        assert imported(file, "mujoco.batch", "mujoco_warp") == []
    if folder not in (
        *physics,
        "pipelines/sim/gait",
        "pipelines/viewing",
    ):  # a viewer reads the model's shapes
        assert file.parts[0] == "robots" or imported(file, "mujoco") == []
    if folder in physics:
        stages = [f"lacoloco.pipelines.{name}" for name in stage_names()]
        assert imported(file, "torch.optim", "rsl_rl", *stages) == []


def module_names():
    """Names of the modules directly in pipelines/."""
    return sorted(file.stem for file in (CHECKOUT / "pipelines").glob("*.py"))


def stage_names():
    """Modules of pipelines/ that hold a stage: they have presets and `run`."""
    names = []
    for name in module_names():
        file = CHECKOUT / "pipelines" / f"{name}.py"
        defined = {node.name for node in ast.parse(file.read_text()).body if hasattr(node, "name")}
        if "run" in defined:
            names.append(name)
    return names


TOGETHER = ("chains", "benchmarks")
"""Folders of pipelines/ that put stages together; nothing else there knows more than one."""


@pytest.mark.parametrize("name", stage_names())
def test_stages_do_not_know_each_other(name):
    others = [f"lacoloco.pipelines.{other}" for other in {*stage_names(), *TOGETHER} - {name}]
    assert imported(Path("pipelines") / f"{name}.py", *others) == []


@pytest.mark.parametrize(
    "file", [file for file in module_files() if file.parts[0] == "lacoloco_cli"], ids=str
)
def test_front_door_imports_heavy_things_only_when_called(file):
    light = {*sys.stdlib_module_names, "typer", "lacoloco_cli"}
    top = {name.split(".")[0] for name in imports_of(file, top_level_only=True)}
    assert top - light == set()


@pytest.mark.parametrize("name", TRAINING)
def test_training_needs_neither_retargeting_nor_viewer(name):
    # they are large, and a training machine may lack them
    code = (
        f"import sys, lacoloco.pipelines.{name}\n"
        "found = [m for m in ('casadi', 'pinocchio', 'meshcat') if m in sys.modules]\n"
        "print(found, file=sys.stderr)\n"
    )
    ran = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert ran.stderr.strip() == "[]"


@pytest.fixture(scope="session")
def distribution(tmp_path_factory):
    """An sdist, and the wheel built from it, of a copy of the checkout: (sdist, wheel)."""
    work = tmp_path_factory.mktemp("distribution")
    copy = work / "checkout"
    ignored = shutil.ignore_patterns(*BUILT, ".git", "*.egg-info")
    shutil.copytree(CHECKOUT, copy, ignore=ignored)
    command = [sys.executable, "-m", "build", "--no-isolation", "--outdir", str(work / "dist")]
    built = subprocess.run([*command, str(copy)], capture_output=True, text=True)
    assert built.returncode == 0, built.stdout[-3000:] + built.stderr[-3000:]
    (sdist,) = (work / "dist").glob("*.tar.gz")
    (wheel,) = (work / "dist").glob("*.whl")
    return sdist, wheel


@pytest.mark.slow
def test_wheel_holds_every_file_of_the_rooms(distribution):
    _, wheel = distribution
    with zipfile.ZipFile(wheel) as archive:
        inside = set(archive.namelist())
    for room in (*ROOMS, "lacoloco_cli"):
        prefix = "" if room == "lacoloco_cli" else "lacoloco/"
        for file in (CHECKOUT / room).rglob("*"):
            name = file.relative_to(CHECKOUT)
            if file.is_file() and file.suffix != ".md" and "__pycache__" not in name.parts:
                assert f"{prefix}{name.as_posix()}" in inside
    assert any(name.endswith("licenses/NOTICE") for name in inside)
    assert {name.split("/")[0] for name in inside if ".dist-info" not in name} == {
        "lacoloco",
        "lacoloco_cli",
    }


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["sdist", "wheel"])
def test_it_runs_outside_the_checkout(distribution, kind, tmp_path):
    archive = distribution[("sdist", "wheel").index(kind)]
    site = tmp_path / "site"
    pip = [sys.executable, "-m", "pip", "install", "--quiet", "--no-deps", "--no-build-isolation"]
    subprocess.run([*pip, "--target", str(site), str(archive)], check=True)

    def run(*arguments):
        # -S leaves out the editable install; the dependencies come from its folder
        folders = [str(site), sysconfig.get_path("purelib")]
        environment = {**os.environ, "PYTHONPATH": os.pathsep.join(folders)}
        return subprocess.run(
            [sys.executable, "-S", *arguments],
            cwd=tmp_path,
            env=environment,
            capture_output=True,
            text=True,
        )

    where = run("-c", "import lacoloco.robots.registry as r; print(r.__file__)")
    assert Path(where.stdout.strip()).is_relative_to(site), where.stderr
    script = str(site / "bin" / "lacoloco")
    helped = run(script, "--help")
    assert helped.returncode == 0, helped.stderr
    assert "train-low" in helped.stdout
    robots = run(script, "robots", "list", "--json")
    assert robots.returncode == 0, robots.stderr
    assert "solo12" in robots.stdout and "h1" in robots.stdout
