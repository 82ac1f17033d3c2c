import json
import os
import pickle

import numpy as np
import pytest
from typer.testing import CliRunner

from lacoloco.datasets.clip import Clip, load_clips, save_clips
from lacoloco.datasets.store import RunStore
from lacoloco.pipelines.robot import record_of
from lacoloco.robots.registry import load_robot
from lacoloco_cli.main import app


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.fixture
def library(folder):
    """Two clips of a robot that stands and turns, in a file."""
    spec = load_robot("solo12")
    frames = 30
    pose = np.tile(spec.default_joint_pos, (frames, 1))
    quat = np.tile([1.0, 0.0, 0.0, 0.0], (frames, 1))
    clips = []
    for name, speed in (("slow/one", 0.1), ("fast", 0.5)):
        pos = np.zeros((frames, 3)) + [0.0, 0.0, spec.default_height()]
        pos[:, 0] = speed * np.arange(frames) / 50
        clips.append(Clip.from_poses(name, 50, spec.joint_names, pos, quat, pose, skill=name[:4]))
    return save_clips(folder / "two.h5", clips, robot=record_of(spec), config={})


def invoke(*arguments):
    return CliRunner().invoke(app, ["motions", *map(str, arguments)])


def answer(*arguments):
    result = invoke(*arguments, "--json")
    assert result.exit_code == 0, result.stderr
    return json.loads(result.stdout)


def refused(*arguments):
    result = invoke(*arguments)
    assert result.exit_code == 2, result.output
    lines = [line for line in result.stderr.splitlines() if line.startswith("error: ")]
    assert len(lines) == 1 and "bug" not in lines[0]
    return lines[0]


def test_what_is_in_a_library_is_shown(library):
    shown = answer("show", library)
    assert [clip["name"] for clip in shown["clips"]] == ["slow/one", "fast"]
    assert [row["skill"] for row in shown["skills"]] == ["slow", "fast"]
    assert shown["total"]["seconds"] == pytest.approx(2 * 29 / 50)
    assert shown["clips"][1]["speed_mean_m_s"] == pytest.approx(0.5, abs=1e-3)
    text = invoke("show", library).stdout
    assert "slow/one" in text and "turning" in text
    assert "no-such" in refused("show", "no-such")


def test_a_picture_is_drawn_where_it_is_asked_for(library, folder):
    assert answer("plot", library, "--out", "motions.png")["clips"] == 2
    assert (folder / "motions.png").read_bytes().startswith(b"\x89PNG")
    (folder / "notes.png").write_text("mine")
    assert "exists and is not a PNG" in refused("plot", library, "--out", "notes.png")
    assert (folder / "notes.png").read_text() == "mine"


def test_what_is_exported_is_imported_into_the_run(library, folder):
    files = answer("export", library, "--to", "out", "--format", "csv")["files"]
    assert [os.path.basename(file) for file in files] == ["slow_one.csv", "fast.csv"]
    made = answer("import", "out", "--run", "mine", "--skill", "taken", "--licence", "CC0-1.0")
    clips = load_clips(RunStore().newest("mine", "import"))
    assert [clip.name for clip in clips] == ["fast", "slow_one"]
    assert (clips[0].skill, clips[0].licence, clips[0].source) == ("taken", "CC0-1.0", "fast.csv")
    np.testing.assert_allclose(clips[0].root_pos, load_clips(library)[1].root_pos, atol=1e-6)
    assert clips[1].contacts.all() and not clips[0].contacts.any()  # its feet slide at 0.5 m/s
    assert made["clips"][0]["quaternion"] == "wxyz"
    (listed,) = answer("list", "mine")["motions"]
    assert (listed["clips"], listed["skills"], listed["robot"]) == (2, ["taken"], "solo12")
    assert "exists already" in refused("export", library, "--to", "out", "--format", "csv")
    assert "runs hold" in refused("export", library, "--to", RunStore().root / "x")


def test_one_bad_file_among_good_ones_is_said(library, folder):
    answer("export", library, "--to", "out", "--clip", "fast")
    (folder / "out" / "bad.csv").write_text("1,2\n")
    result = invoke("import", "out", "--run", "mine")
    assert result.exit_code == 1
    assert "skipped: " in result.stderr and "bad.csv" in result.stderr
    assert len(load_clips(RunStore().newest("mine", "import"))) == 1


class Harm:
    def __reduce__(self):
        return os.mkdir, ("harm",)


def test_a_hostile_pickle_is_refused_in_one_line(folder):
    (folder / "walk.pkl").write_bytes(pickle.dumps({"fps": 30, "frames": Harm()}))
    line = refused("import", "walk.pkl")
    assert "mkdir" in line and "walk.pkl" in line and "nothing of it was executed" in line
    assert not (folder / "harm").exists()


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("import", "gone.npz"), "no such file"),
        (("import", "."), "no file in it ends in"),
        (("import", "a.csv", "--quaternion", "wzyx"), "--quaternion wzyx"),
        (("import", "a.csv", "--fps", "-5"), "--fps -5"),
        (("export", "two.h5", "--format", "bvh"), "use npz, csv, lafan1"),
        (("export", "two.h5", "--clip", "none"), "--clip none"),
        (("export", "two.h5", "--fps", "0"), "--fps 0: use a number from 1"),
        (("export", "two.h5", "--fps", "50", "--format", "lafan1"), "lafan1 has 30"),
        (("export", "two.h5", "--to", "two.h5"), "--to two.h5: is a file"),
    ],
)
def test_mistakes_are_named(library, arguments, words):
    assert words in refused(*arguments)
