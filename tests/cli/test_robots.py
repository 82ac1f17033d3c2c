import json
from types import SimpleNamespace

import numpy as np
import pytest
from typer.testing import CliRunner

from lacoloco.robots.registry import load_robot
from lacoloco_cli.robots import app


@pytest.fixture
def call():
    def run(*arguments):
        return CliRunner().invoke(app, list(arguments))

    return run


def test_list_names_the_robots_and_their_sizes(call):
    robots = json.loads(call("list", "--json").stdout)["robots"]
    assert [(r["name"], r["joints"]) for r in robots] == [
        ("solo12", 12),
        ("h1", 19),
        ("go2", 12),
    ]
    assert [r["total_mass"] for r in robots] == pytest.approx(
        [2.50000279, 51.437, 15.206408], abs=1e-8
    )
    text = call("list").stdout
    assert "solo12" in text and "right_elbow_link + (0.3, 0, 0) m" in text


def test_show_gives_every_joint(call):
    shown = json.loads(call("show", "solo12", "--json").stdout)
    assert shown["feet"] == ["FL_FOOT", "FR_FOOT", "HL_FOOT", "HR_FOOT"]
    assert [joint["default"] for joint in shown["joints"]] == [0.0, 0.4, -0.8] * 4
    assert shown["joints"][11] == {
        "joint": "HR_KFE",
        "default": -0.8,
        "lower": -10.0,
        "upper": 10.0,
        "stiffness": 4.0,
        "damping": 0.2,
        "effort_limit": 3.0,
        "training_effort_limit": 4.5,
        "velocity_limit": 16.0,
    }
    assert "HR_KFE" in call("show", "solo12").stdout


def test_check_finds_every_robot_sound(call):
    result = call("check", "--json")
    report = json.loads(result.stdout)
    assert (result.exit_code, report["passed"]) == (0, True)
    assert [robot["robot"] for robot in report["robots"]] == ["solo12", "h1", "go2"]
    for robot in report["robots"]:
        values = {check["name"]: check["value"] for check in robot["checks"]}
        assert values["positions, MuJoCo - Pinocchio"] < 1e-12
        assert values["rotations, MuJoCo - Pinocchio"] < 1e-12
        assert values["mass matrix, MuJoCo - Pinocchio"] < 1e-10
        assert values["joint order in Pinocchio"] == 0
    said = call("check", "solo12").stdout
    assert "solo12: ok" in said
    assert said.splitlines()[-1] == "next: lacoloco generate --robot solo12"


def test_check_draws_the_standing_robot(call, tmp_path, monkeypatch):
    from lacoloco.pipelines.viewing import opengl, robot_picture

    drawn = []
    monkeypatch.setattr(opengl, "check_gl", lambda: None)
    monkeypatch.setattr(
        robot_picture, "draw_robot", lambda spec, qpos: drawn.append((spec.name, qpos)) or b"PNG"
    )
    file = tmp_path / "solo12.png"
    report = json.loads(call("check", "solo12", "--figure", str(file), "--json").stdout)
    assert (report["figure"], file.read_bytes()) == (str(file), b"PNG")
    ((name, qpos),) = drawn
    stance = report["robots"][0]["stance"]
    assert (name, stance["fell"], "qpos" in stance) == ("solo12", "", False)
    assert qpos[2] == pytest.approx(stance["height"] * (1.0 - stance["sag"]))


def test_a_robot_with_a_gait_is_drawn_before_it_falls(tmp_path, monkeypatch):
    from lacoloco.pipelines.viewing import robot_picture
    from lacoloco_cli.robots import _draw

    h1, drawn = load_robot("h1"), []
    monkeypatch.setattr(robot_picture, "draw_robot", lambda spec, qpos: drawn.append(qpos) or b"")
    fallen = SimpleNamespace(stance=SimpleNamespace(qpos=0.0 * h1.default_qpos()))
    _draw(h1, fallen, tmp_path / "h1.png")
    assert np.array_equal(drawn[0], h1.default_qpos())


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("--figure", "all.png"), "--figure draws one robot; name it"),
        (
            ("solo12", "--figure", "solo12.bmp"),
            "--figure solo12.bmp: give it a name that ends in .png",
        ),
    ],
)
def test_a_figure_that_cannot_be_drawn_is_refused(call, arguments, words):
    result = call("check", *arguments)
    assert (result.exit_code, words in result.stderr) == (2, True)


def test_check_of_a_faulty_robot_ends_with_exit_code_2(call, monkeypatch):
    from dataclasses import replace

    from lacoloco.robots import registry

    faulty = replace(registry.load_robot("solo12"), velocity_limits=(0.0,) * 12)
    monkeypatch.setattr(registry, "load_robot", lambda name: faulty)
    result = call("check", "solo12", "--json")
    report = json.loads(result.stdout)
    assert (result.exit_code, report["passed"]) == (2, False)
    failing = [c["name"] for c in report["robots"][0]["checks"] if not c["passed"]]
    assert failing == ["speed not positive"]
    assert report["exit_code"] == 2
    shown = call("check", "solo12")
    assert (shown.exit_code, shown.stdout) == (2, "")
    assert shown.stderr == f"error: {report['error']}\n"
    expected = (
        "robot.toml: joints: speed of joint 'FL_HAA': expected a number above 0 rad/s; found 0"
    )
    assert expected in shown.stderr


def test_a_published_model_is_imported_and_what_it_lacks_is_asked_for(call, tmp_path):
    from lacoloco.robots.registry import load_robot

    published = load_robot("solo12").mjcf
    arguments = ("import", str(published), "--name", "dog", "--to", str(tmp_path))
    made = json.loads(call(*arguments, "--json").stdout)
    assert made["folder"] == str(tmp_path / "dog")
    assert load_robot(tmp_path / "dog").feet == load_robot("solo12").feet
    asked = {question["key"]: question["what"] for question in made["questions"]}
    assert set(asked) == {"robot.toml: joints: speed"}
    assert "speed limit of the motor, rad/s, of every joint" in asked["robot.toml: joints: speed"]
    assert any(note.startswith("stands for 10 s under its gains") for note in made["notes"])
    again = call(*arguments)
    assert (again.exit_code, again.stdout) == (2, "")
    assert "dog: is there already; choose another name, or another --to" in again.stderr


def test_an_import_of_no_file_is_refused_in_one_line(call, tmp_path):
    result = call("import", "none.xml", "--name", "dog", "--to", str(tmp_path))
    assert (result.exit_code, result.stdout) == (2, "")
    assert result.stderr == "error: none.xml: no such file; give an MJCF or a URDF\n"


def test_an_unknown_robot_is_refused_with_the_nearest(call):
    result = call("show", "solo", "--json")
    assert result.exit_code == 2
    assert "did you mean 'solo12'" in json.loads(result.stdout)["error"]
