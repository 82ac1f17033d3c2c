"""The walk-throughs of the READMEs: their shell blocks, as they stand, in an empty folder."""

import re
import shlex
import subprocess
from pathlib import Path

import pytest
from typer.testing import CliRunner

from lacoloco.datasets.clip import load_clips
from lacoloco.datasets.store import RunStore
from lacoloco.pipelines.policies import load_policies
from lacoloco_cli.main import app

CHECKOUT = Path(__file__).parents[1]


def blocks(room, heading):
    """The shell blocks of a section, up to the next heading."""
    text = (CHECKOUT / room / "README.md").read_text()
    (section,) = re.findall(rf"^#+ {heading}\n(.*?)(?=^#+ |\Z)", text, re.MULTILINE | re.DOTALL)
    found = re.findall(r"^```sh\n(.*?)^```$", section, re.MULTILINE | re.DOTALL)
    assert found and section.count("```") == 2 * len(found)
    return found


def pieces(block):
    """Parts of a block that are typed one after another: each `lacoloco` line is one."""
    lines = re.split(r"^(lacoloco .*)\n", block, flags=re.MULTILINE)
    return [line for line in lines if line.strip()]


def typed(piece):
    """What a part prints; `lacoloco` runs in this process, as it has imported everything."""
    if piece.startswith("lacoloco "):
        ran = CliRunner().invoke(app, shlex.split(piece)[1:])
        assert ran.exit_code == 0, ran.output
        return ran.output
    shell = ["bash", "-euo", "pipefail", "-c", piece]
    ran = subprocess.run(shell, capture_output=True, text=True, check=False)
    assert ran.returncode == 0, ran.stderr
    return ran.stdout


@pytest.fixture
def walk(tmp_path, monkeypatch):
    """Runs a walk-through beside the clone; gives the folder, its runs and what was printed."""
    folder = tmp_path / "trial"
    folder.mkdir()
    (tmp_path / "lacoloco").symlink_to(CHECKOUT)
    monkeypatch.delenv("LACOLOCO_RUNS")
    monkeypatch.chdir(folder)

    def run(room, heading):
        printed = ["".join(map(typed, pieces(block))) for block in blocks(room, heading)]
        return folder, RunStore(folder / "runs"), printed

    return run


@pytest.mark.slow
def test_own_robot(walk):
    folder, store, printed = walk("robots", "Walk-through: your own robot")
    assert "robot.toml: joints: speed" in printed[0]
    assert "rover: ok" in printed[1]
    toml = (folder / "rover" / "robot.toml").read_text()
    assert toml.count("speed = 21.0") == 12 and "speed: ASK" not in toml
    low = load_policies(store.newest("rover", "train-low"))[1]["low"]
    assert low.head.actions == 12
    assert store.newest("rover", "eval").is_file()


@pytest.mark.slow
def test_own_motion(walk):
    folder, store, printed = walk("datasets", "Walk-through: your own motion")
    assert "moved to 0" in printed[0]
    (trot,) = load_clips(store.newest("mine", "import"))
    assert (trot.name, trot.duration) == ("trot", pytest.approx(89 / 30, abs=0.02))
    forward = trot.root_lin_vel_b[:, 0].mean()
    assert forward == pytest.approx(0.4, abs=0.01)
    assert trot.contacts.mean(axis=0) == pytest.approx(0.5, abs=0.15), "each foot half of the time"
    assert "trot" in printed[1] and (folder / "trot.png").stat().st_size > 10_000
    assert len(load_clips(store.newest("mine", "track"))) > 0
    load_policies(store.newest("mine", "train-low"))


@pytest.mark.slow
def test_own_task(walk):
    _, store, printed = walk("robots", "Walk-through: your own task")
    policy = load_policies(store.newest("turn", "train-high"))[1]["high"]
    assert policy.head.task == "turn"
    assert store.newest("turn", "eval").is_file()
    assert "reward" in printed[1]
