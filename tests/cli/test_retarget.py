import json

import pytest
from typer.testing import CliRunner

from lacoloco.datasets.samples import DOG_BVH
from lacoloco_cli.main import app


def invoke(*arguments):
    return CliRunner().invoke(app, ["retarget", *map(str, arguments)])


NO_PICTURE = ("--set", "pictures=false")


@pytest.fixture
def dog(tmp_path):
    """A second of the bundled dog."""
    lines = DOG_BVH.read_text().splitlines()
    motion = lines.index("MOTION")
    path = tmp_path / "dog.bvh"
    rows = lines[motion + 3 :][:60]
    path.write_text("\n".join([*lines[: motion + 1], "Frames: 60", lines[motion + 2], *rows, ""]))
    return path


def test_json_gives_figures_per_clip_and_the_rate(dog):
    result = invoke(dog, "--json", "--quiet")
    assert result.exit_code == 0, result.stderr
    answer = json.loads(result.stdout)
    (clip,) = answer["clips"]
    assert {
        "frames",
        "keypoint_error_mean_m",
        "keypoint_error_max_m",
        "foot_skate_mean_m_s",
        "ground_penetration_max_m",
        "joint_limit_hits",
        "solver_failures",
    } <= set(clip)
    assert answer["frames_per_second"] > 0
    assert answer["artifact"].endswith("artifact.h5")


def test_a_table_is_shown_to_people(dog):
    result = invoke(dog, "--quiet")
    assert result.exit_code == 0, result.stderr
    assert "skate m/s" in result.stdout
    assert "dog" in result.stdout


def test_options_reach_the_config(dog):
    from lacoloco.datasets.artifact import read_header

    result = invoke(dog, "--scale", "0.6", "--licence", "CC0", "--json", "--quiet")
    answer = json.loads(result.stdout)
    assert answer["clips"][0]["scale"] == 0.6
    header = read_header(answer["artifact"])
    assert header.config["licence"] == "CC0"
    assert header.metadata["clips"][0]["licence"] == "CC0"


def test_one_bad_file_among_good_ones_is_exit_code_1(dog, tmp_path):
    (tmp_path / "empty.bvh").touch()
    result = invoke(tmp_path, "--json", "--quiet", "--jobs", "1", *NO_PICTURE)
    assert result.exit_code == 1
    answer = json.loads(result.stdout)
    assert [clip["name"] for clip in answer["clips"]] == ["dog"]
    assert answer["skipped"][0]["file"].endswith("empty.bvh")


DAMAGES = {
    "empty": lambda text: "",
    "truncated": lambda text: text[: len(text) * 2 // 3],
    "not a number": lambda text: (
        text.replace("0 0 0", "nan 0 0") if "0 0 0" in text else text.rsplit(" ", 1)[0] + " nan\n"
    ),
    "missing joint": lambda text: text.replace("LeftUpLeg", "Thigh"),
    "no frames": lambda text: (
        text[: text.index("MOTION")] + "MOTION\nFrames: 0\nFrame Time: 0.01\n"
    ),
    "picture": lambda text: "\x89PNG\r\n\x1a\n",
    "no motion": lambda text: text[: text.index("MOTION")],
}


@pytest.mark.parametrize("damage", DAMAGES)
def test_a_bad_file_is_one_line_and_exit_code_2(dog, damage):
    dog.write_text(DAMAGES[damage](dog.read_text()))
    result = invoke(dog, "--quiet")
    assert result.exit_code == 2, result.stdout
    (line,) = result.stderr.strip().splitlines()
    assert "dog" in line
    assert "Traceback" not in line


@pytest.mark.parametrize(
    ("arguments", "hint"),
    [
        (["gone.bvh"], "gone.bvh"),
        (["no-*.bvh"], "matches no file"),
        (["--robot", "solo13"], "solo12"),
        (["--preset", "huge"], "laptop"),
        (["--set", "scal=1"], "scale"),
        (["--scale", "huge"], "auto"),
        (["--up-axis", "w"], "--up-axis w"),
        (["--up-axis", "-y"], "--up-axis=y"),
        (["--unit", "-1"], "--unit"),
        (["--unit", "0"], "--unit 0: use a number above 0"),
        (["--source-fps", "0"], "--source-fps 0: use a number above 0"),
        (["x" * 300 + ".bvh"], "file name too long"),
        (["--trim", "5"], "120:600"),
        (["--select", "cats"], "paper-dogs"),
        (["--map", "gone.toml"], "gone.toml"),
    ],
)
def test_mistakes_on_the_command_line(arguments, hint):
    result = invoke(*arguments, "--quiet")
    assert result.exit_code == 2
    assert hint in result.stderr


def test_a_read_only_runs_folder(dog, read_only_folder, monkeypatch):
    monkeypatch.setenv("LACOLOCO_RUNS", str(read_only_folder / "runs"))
    result = invoke(dog, "--quiet")
    assert result.exit_code == 2
    assert str(read_only_folder) in result.stderr


def test_maps_and_selections_are_listed():
    result = invoke("--maps")
    assert result.exit_code == 0, result.stderr
    assert "mann-dog" in result.stdout and "LeftHand" in result.stdout
    assert "paper-dogs" in result.stdout
    answer = json.loads(invoke("--maps", "--json").stdout)
    robots = {row["name"]: row["robot"] for row in answer["maps"]}
    assert robots["mann-dog"] == "solo12" and robots["lafan1"] == "h1"
    assert answer["selections"][0]["clips"] == 41


def test_a_selection_that_is_incomplete_is_exit_code_1(dog, tmp_path):
    selection = tmp_path / "mine.toml"
    selection.write_text("[clips]\ndog = [0, 40]\ngone = []\n")
    result = invoke(tmp_path, "--select", selection, "--quiet", *NO_PICTURE)
    assert result.exit_code == 1
    assert "not there: gone" in result.stdout


def test_the_second_call_finds_everything_there(dog):
    first = json.loads(invoke(dog, "--json", "--quiet").stdout)
    second = json.loads(invoke(dog, "--json", "--quiet").stdout)
    assert second["kept"] == 1
    assert second["artifact"] == first["artifact"]
    (picture,) = second["reports"]
    assert picture.endswith("report.png")
