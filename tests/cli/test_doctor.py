from __future__ import annotations

import json
from importlib import metadata

import pytest
from typer.testing import CliRunner

from lacoloco_cli import doctor
from lacoloco_cli.main import app


def invoke(*arguments):
    return CliRunner().invoke(app, ["doctor", *arguments])


def test_healthy_installation():
    report = json.loads(invoke("--json").stdout)
    names = {check["name"] for check in report["checks"]}
    assert {"python", "mujoco", "torch", "pin", "casadi", "rsl-rl-lib", "runs folder"} <= names
    assert [check for check in report["checks"] if not check["ok"]] == []
    assert report["ok"] is True
    assert "control steps/s" in report["checks"][-1]["found"]
    assert "mujoco.batch" in report["engine"] or "Warp" in report["engine"]


def test_table_says_the_engine_and_why():
    result = invoke()
    assert result.exit_code == 0
    assert "engine: " in result.stdout and "torch" in result.stdout
    versions = result.stdout.splitlines()[-1]
    for name in ("gpu ", "driver ", "cuda ", f"torch {metadata.version('torch')}", "warp-lang "):
        assert name in versions


def test_a_forced_engine_is_said(monkeypatch):
    monkeypatch.setenv("LACOLOCO_PHYSICS", "warp")
    engine, reason = doctor.choose_engine()
    assert "LACOLOCO_PHYSICS=warp" in engine + reason


def test_throughput_is_measured_if_asked_for(monkeypatch):
    from lacoloco.pipelines.benchmarks import throughput as bench

    asked = []

    def measured(config, *, robot, device):
        asked.append((config.seconds, config.worlds, robot, device))
        return {"steps_per_second": 1000.0 * len(asked)}

    for name in ("bench_sim", "bench_train"):
        monkeypatch.setattr(bench, name, measured)
    assert doctor.throughput("cuda") == {"environment loop": 1000.0, "low-level training": 2000.0}
    assert asked == [(5.0, 4096, "solo12", "cuda")] * 2


def test_mujoco_left_over_from_before_the_split_is_found(monkeypatch):
    versions = {"mujoco": "3.9.0", "mujoco-core": "4.0.0", "mujoco-studio": "4.0.0"}
    monkeypatch.setattr(metadata, "version", versions.__getitem__)
    check = doctor.check_mujoco()
    assert not check.ok
    assert "--force-reinstall" in check.fix
    assert "mujoco 3.9.0" in check.found


def test_dependency_of_another_version_is_found(monkeypatch):
    real = metadata.version
    monkeypatch.setattr(
        metadata, "version", lambda name: "5.6.0" if name == "rsl-rl-lib" else real(name)
    )
    (check,) = [c for c in doctor.check_requirements() if c.name == "rsl-rl-lib"]
    assert not check.ok
    assert check.fix.startswith("pip install 'rsl-rl-lib")


def test_missing_dependency_is_found(monkeypatch):
    real = metadata.version

    def version(name):
        if name == "casadi":
            raise metadata.PackageNotFoundError(name)
        return real(name)

    monkeypatch.setattr(metadata, "version", version)
    (check,) = [c for c in doctor.check_requirements() if c.name == "casadi"]
    assert (check.ok, check.found) == (False, "missing")


def test_broken_import_is_one_line(monkeypatch):
    def broken(name):
        raise ImportError("libstdc++.so.6:\nno such file")

    monkeypatch.setattr(doctor, "import_module", broken)
    checks = list(doctor.check_requirements())
    assert not any(check.ok for check in checks)
    assert all("\n" not in check.found for check in checks)


@pytest.mark.parametrize(("found", "ok"), [("3.10.14", False), ("3.12.1", True), ("3.14.0", False)])
def test_python_is_compared_with_what_the_package_asks_for(monkeypatch, found, ok):
    monkeypatch.setattr(doctor.platform, "python_version", lambda: found)
    assert doctor.check_python().ok == ok


def test_read_only_runs_folder_is_found(read_only_folder):
    check = doctor.check_runs(read_only_folder / "runs")
    assert not check.ok
    assert str(read_only_folder) in check.fix and "LACOLOCO_RUNS" in check.fix


def test_simulation_that_does_not_run_is_found(monkeypatch):
    from lacoloco.pipelines.benchmarks import throughput as bench

    def broken(config, *, robot):
        raise OSError("libmujoco.so: cannot be opened")

    monkeypatch.setattr(bench, "bench_sim", broken)
    check = doctor.check_simulation()
    assert not check.ok and "libmujoco.so" in check.found and check.fix


def test_failing_check_is_exit_code_2_and_still_reported(monkeypatch):
    failing = doctor.Check("runs folder", False, "full", "delete something")
    monkeypatch.setattr(doctor, "check_runs", lambda root: failing)
    result = invoke("--json")
    assert result.exit_code == 2
    report = json.loads(result.stdout)
    assert report["ok"] is False
    assert report["checks"][-2] == {
        "name": "runs folder",
        "ok": False,
        "found": "full",
        "fix": "delete something",
    }
    assert "FAILS" in invoke().stdout
