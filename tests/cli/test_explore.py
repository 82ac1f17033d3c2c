import json

import pytest
from typer.testing import CliRunner

from lacoloco.datasets.published import find
from lacoloco.datasets.store import RunStore
from lacoloco.pipelines.exploring import live, server
from lacoloco_cli.main import app


def invoke(*arguments):
    return CliRunner().invoke(app, ["explore", *map(str, arguments), "--quiet"])


@pytest.fixture
def explored(monkeypatch):
    """Stands in for the loop, which ends at once, as if by Ctrl-C; the worlds that it was given."""
    pytest.importorskip("viser")
    worlds = []

    def run(world, page, stop):
        worlds.append(world)
        raise KeyboardInterrupt

    monkeypatch.setattr(live, "run", run)
    return worlds


def test_a_published_low_level_by_its_name(explored):
    result = invoke("solo12-synthetic-low", "--json")
    assert result.exit_code == 0, result.stderr
    answer = json.loads(result.stdout)
    assert answer["robot"] == "solo12"
    assert answer["address"].startswith("http://127.0.0.1:")
    assert answer["address"] in result.stderr
    assert not explored[0].has_target


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


def test_without_viser_it_says_how_to_install_it(monkeypatch):
    monkeypatch.setattr(server, "find_spec", lambda name: None)
    result = invoke("solo12-synthetic-low")
    assert result.exit_code == 2
    assert "pip install 'lacoloco[explore]'" in result.stderr
    assert result.stderr.count("\n") == 1
