from __future__ import annotations

import json

import pytest
from typer.testing import CliRunner

from lacoloco_cli.main import app

SMOKE = ("--preset", "smoke")


def invoke(*arguments):
    return CliRunner().invoke(app, ["bench", *arguments])


def answer(*arguments):
    result = invoke(*arguments, "--json")
    assert result.exit_code == 0, result.stderr
    return json.loads(result.stdout)


def test_sim_gives_a_rate_and_a_ratio():
    metrics = answer("sim", *SMOKE)
    assert metrics["steps_per_second"] > 0
    assert metrics["ratio_to_engine"] > 0
    assert (metrics["robot"], metrics["task"], metrics["worlds"]) == ("solo12", "walk", 8)
    assert sum(metrics["shares"].values()) == pytest.approx(1.0, abs=1e-6)


def test_sim_takes_another_task_robot_and_size():
    metrics = answer("sim", "--task", "reach", "--robot", "h1", "--set", "worlds=3", *SMOKE)
    assert (metrics["robot"], metrics["task"], metrics["worlds"]) == ("h1", "reach", 3)


@pytest.mark.slow
def test_train_gives_a_rate_and_a_ratio():
    metrics = answer("train", "--disc", "gan", "--no-cat", *SMOKE)
    assert metrics["method"] == "gan"
    assert metrics["steps_per_second"] > 0 and metrics["ratio_to_engine"] > 0


@pytest.mark.slow
def test_retarget_gives_a_rate_and_a_ratio():
    metrics = answer("retarget")
    assert metrics["frames_per_second"] > 0 and metrics["ratio_to_engine"] > 0


def test_a_person_sees_the_ratio_and_where_the_time_goes():
    printed = invoke("sim", *SMOKE).stdout
    assert "steps_per_second" in printed and "ratio_to_engine" in printed
    assert "physics" in printed and "%" in printed


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["sim", "--task", "dance"], "walk"),
        (["sim", "--robot", "solo13"], "solo12"),
        (["train", "--disc", "wgan"], "gan or drail"),
        (["sim", "--set", "wrlds=3"], "'worlds'"),
        (["retarget", "no_such.bvh"], "no_such.bvh"),
    ],
)
def test_what_does_not_exist_is_refused(arguments, said):
    result = invoke(*arguments)
    assert result.exit_code == 2
    assert result.stderr.count("\n") == 1
    assert said in result.stderr


@pytest.mark.slow
def test_motions_are_loaded_in_a_process_of_their_own():
    metrics = answer("motions", "--hours", "0.02")
    assert metrics["clips"] == 7
    assert min(metrics["load_cpu_s"], metrics["build_cpu_s"], metrics["transitions_ms"]) > 0
    assert metrics["bytes"] > 7 * 500 * 49 * 4
