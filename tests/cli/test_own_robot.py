"""A robot of one's own, which lacoloco knows nothing of but its folder, goes through the chain."""

import json
import shutil
from pathlib import Path

import pytest
from typer.testing import CliRunner

from lacoloco.datasets.artifact import read_header
from lacoloco.datasets.store import RunStore
from lacoloco_cli.main import app

SMOKE = ("--preset", "smoke", "--quiet")


class Cli:
    """`lacoloco` working in a runs folder."""

    def __init__(self, root):
        self.store = RunStore(root)

    def invoke(self, *arguments):
        return CliRunner().invoke(app, list(arguments), env={"LACOLOCO_RUNS": str(self.store.root)})

    def answer(self, *arguments):
        result = self.invoke(*arguments, "--json")
        assert result.exit_code == 0, result.stderr
        return json.loads(result.stdout)

    def refusal(self, *arguments):
        result = self.invoke(*arguments)
        assert result.exit_code == 2, result.stderr
        assert result.stderr.count("\n") == 1, result.stderr
        return result.stderr


@pytest.fixture
def cli(tmp_path):
    return Cli(tmp_path / "runs")


@pytest.mark.slow
def test_a_renamed_robot_goes_through_the_chain_and_outlives_its_folder(
    cli, renamed_robot, tmp_path
):
    rover = str(renamed_robot(tmp_path / "mine"))
    assert cli.answer("robots", "check", "--robot", rover)["passed"]
    generated = cli.answer("generate", "--robot", rover, "--run", "own", *SMOKE)
    assert generated["clips"] > 0
    cli.answer("train-low", *SMOKE)
    cli.answer("train-high", *SMOKE)
    before = cli.answer("eval", *SMOKE)
    exported = cli.answer("export", *SMOKE)
    assert exported["max_abs_difference"] <= 1e-5
    described = json.loads((Path(exported["folder"]) / "policy.json").read_text())
    assert described["robot"] == "rover" and described["joint_names"][0] == "pl_spread"
    for stage in ("generate", "train-low", "train-high", "eval", "export"):
        header = read_header(cli.store.newest("own", stage))
        assert (header.robot, header.robot_folder) == ("rover", rover)
        assert set(header.robot_files) == {"robot.toml", "rover.xml"}

    shutil.rmtree(rover)
    result = cli.invoke("eval", *SMOKE[:2], "--json")
    assert result.exit_code == 0, result.stderr
    assert f"{rover} is not there; taking the files that" in result.stderr
    after = json.loads(result.stdout)
    different = {"artifact", "seeds_found", "seeds_asked"}
    assert {k: v for k, v in after.items() if k not in different} == {
        k: v for k, v in before.items() if k not in different
    }, "the same metrics, bit for bit"
    page = tmp_path / "page.html"
    assert cli.answer("play", "--html", str(page), *SMOKE)["robot"] == "rover"
    assert page.stat().st_size > 10_000
    assert cli.answer("export", *SMOKE)["max_abs_difference"] <= 1e-5
    assert "no robot there" in cli.refusal("generate", "--robot", rover, *SMOKE)


@pytest.mark.slow
def test_motions_of_two_versions_of_a_robot_are_refused(cli, renamed_robot, tmp_path):
    rover = renamed_robot(tmp_path / "mine")
    cli.answer("generate", "--robot", str(rover), "--run", "old", *SMOKE)
    (rover / "rover.xml").write_text((rover / "rover.xml").read_text().replace("<!--", "<!-- 2", 1))
    cli.answer("generate", "--robot", str(rover), "--run", "new", *SMOKE)
    assert len(cli.store.all("new", "experts")) == 1
    both = [str(cli.store.newest(run, "generate")) for run in ("old", "new")]
    typed = ("train-low", "--motions", both[0], "--motions", both[1], *SMOKE)
    assert "different versions of robot 'rover'" in cli.refusal(*typed)
    cli.answer("generate", "--robot", str(rover), "--run", "old", *SMOKE)
    assert len(cli.store.all("old", "experts")) == 2, "the older experts are of another robot"


def test_robots_says_where_a_robot_comes_from(cli, renamed_robot, tmp_path, monkeypatch):
    rover = renamed_robot(tmp_path / "mine")
    monkeypatch.setenv("LACOLOCO_ROBOTS", str(tmp_path / "mine"))
    rows = {row["name"]: row for row in cli.answer("robots", "list")["robots"]}
    assert [row["origin"] for row in rows.values()] == ["lacoloco"] * 3 + ["LACOLOCO_ROBOTS"]
    assert rows["rover"]["folder"] == str(rover)
    assert "LACOLOCO_ROBOTS" in cli.invoke("robots", "list").stdout
    by_name, by_path = (cli.answer("robots", "show", which) for which in ("rover", str(rover)))
    assert by_name == by_path == cli.answer("robots", "show", "--robot", str(rover))
    assert by_name["feet"] == ["pl_toe", "pr_toe", "ql_toe", "qr_toe"]
    assert cli.answer("robots", "check", str(rover))["passed"]


def test_mistakes_about_robots_are_one_line(cli, renamed_robot, tmp_path, monkeypatch):
    rover = renamed_robot(tmp_path / "mine", "h1")
    assert "'h1' is another robot" in cli.refusal("robots", "check", "--robot", str(rover))
    assert "'h1' is another robot" in cli.refusal("generate", "--robot", str(rover), *SMOKE)
    assert "which robot?" in cli.refusal("robots", "show")
    assert "name one robot" in cli.refusal("robots", "show", "solo12", "--robot", "h1")
    for verb in (("generate",), ("retarget",), ("run", "quickstart")):
        nowhere = str(tmp_path / "nowhere")
        assert "no robot there" in cli.refusal(*verb, "--robot", nowhere, *SMOKE)
    monkeypatch.setenv("LACOLOCO_ROBOTS", str(tmp_path / "nowhere"))
    assert "LACOLOCO_ROBOTS: no such folder" in cli.refusal("robots", "list")
