"""`lacoloco bench experts`."""

import json

import pytest
from typer.testing import CliRunner

from lacoloco_cli.main import app


def invoke(*arguments):
    return CliRunner().invoke(app, ["bench", "experts", *arguments])


def test_the_published_experts_are_assessed():
    metrics = json.loads(invoke("--episodes", "4", "--seconds", "0.4", "--json").stdout)
    assert metrics["experts"].endswith("solo12-experts.h5")
    assert metrics["walk_falls_pct"] == metrics["reach_falls_pct"] == 0.0
    assert 0.0 < metrics["walk_velocity_error"] < 1.0


@pytest.mark.parametrize("name", ["nobody-experts", "solo12-synthetic"])
def test_what_holds_no_experts_is_refused_in_one_line(name):
    result = invoke(name)
    assert result.exit_code == 2
    assert len(result.stderr.strip().splitlines()) == 1
