import json
import socket
from dataclasses import replace

import pytest
from typer.testing import CliRunner

from lacoloco.datasets.clip import save_clips
from lacoloco.datasets.published import find
from lacoloco.datasets.store import RunStore
from lacoloco.pipelines.exploring import explorer, server
from lacoloco.robots.registry import load_robot
from lacoloco_cli.main import app

FEW = ("--latents", "2")


def invoke(*arguments):
    return CliRunner().invoke(app, ["explore", *map(str, arguments), "--quiet", *FEW])


@pytest.fixture
def explored(monkeypatch):
    """Stands in for the loop, which ends at once, as if by Ctrl-C; what it was given."""
    pytest.importorskip("viser")
    calls = []

    def run(world, page, stop, clips):
        calls.append((world, page, clips))
        raise KeyboardInterrupt

    monkeypatch.setattr(explorer, "run", run)
    return calls


def test_a_published_low_level_by_its_name(explored):
    result = invoke("solo12-synthetic-low", "--json")
    assert result.exit_code == 0, result.stderr
    answer = json.loads(result.stdout)
    assert answer["robot"] == "solo12"
    assert answer["address"].startswith("http://127.0.0.1:")
    assert answer["address"] in result.stderr
    world, page, clips = explored[0]
    assert not world.has_target
    assert len(page.drawn) == 1  # the map
    assert clips is None
    assert "--motions" not in result.stderr  # quiet


def test_it_says_how_far_the_map_is_and_what_would_name_clips(explored):
    arguments = ["explore", "solo12-synthetic-low", *FEW]
    result = CliRunner().invoke(app, arguments)
    assert result.exit_code == 0, result.stderr
    assert "--motions names them" in result.stderr
    assert "holding 2 latents  150/150 (100%)" in result.stderr


def test_a_high_level_brings_a_target_and_motions_bring_names(explored, make_clip, tmp_path):
    spec = load_robot("solo12")
    clip = replace(make_clip(joints=12), joint_names=spec.joint_names)
    motions = tmp_path / "motions.h5"
    save_clips(motions, [clip], robot=(spec.name, spec.model_hash()), config={})
    result = invoke("solo12-synthetic", "--motions", motions)
    assert result.exit_code == 0, result.stderr
    world, page, clips = explored[0]
    assert world.has_target
    assert len(page.drawn) == 2  # target and map
    assert clips.nearest(world.frame[None].numpy()) == "circle"


def test_the_newest_low_level_of_a_run(explored):
    store = RunStore()
    folder = store.root / "seen" / "train-low" / "0001"
    folder.mkdir(parents=True)
    (folder / "artifact.h5").write_bytes(find("solo12-synthetic-low").read_bytes())
    for arguments in (["seen"], ["--run", "seen"]):
        result = invoke(*arguments)
        assert result.exit_code == 0, result.stderr
        assert result.stdout == ""
    assert len(explored) == 2


@pytest.mark.parametrize(
    ("arguments", "hint"),
    [
        (["gone.h5"], "gone.h5"),
        ([], "has nothing of train-low or train-high"),
        (["solo12-experts"], "not the low policy"),
    ],
)
def test_mistakes(explored, arguments, hint):
    result = invoke(*arguments)
    assert result.exit_code == 2
    assert hint in result.stderr
    assert result.stderr.count("\n") == 1
    assert not explored


def test_a_port_that_is_taken_is_refused_before_the_work(explored, monkeypatch):
    monkeypatch.setattr(explorer, "hold_sampled", None)
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = taken.getsockname()[1]
        result = invoke("solo12-synthetic-low", "--port", port)
    assert result.exit_code == 2
    assert f"--port {port}" in result.stderr
    assert result.stderr.count("\n") == 1


def test_without_viser_it_says_how_to_install_it(monkeypatch):
    monkeypatch.setattr(server, "find_spec", lambda name: None)
    result = invoke("solo12-synthetic-low")
    assert result.exit_code == 2
    assert "pip install 'lacoloco[explore]'" in result.stderr
    assert result.stderr.count("\n") == 1
