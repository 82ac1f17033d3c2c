from __future__ import annotations

import json

import pytest
import typer
from typer.testing import CliRunner

from lacoloco.datasets.robot_record import RobotRecord
from lacoloco.datasets.store import RunStore
from lacoloco.datasets.work import Work
from lacoloco.pipelines.stage import StageResult
from lacoloco_cli.seeds import contexts, train_seeds
from lacoloco_cli.session import Session, verb


@pytest.fixture
def trained():
    """What a stage that trains nothing was asked to do: (seed, resume) each."""
    return []


@pytest.fixture
def train(trained, tmp_path):
    """A verb `train` with `--seeds` whose stage only takes note."""

    def stage(context):
        trained.append((context.seed, context.resume))
        metrics = {"seed": context.seed, "samples": 10, "speed": 0.5, "loss": 1.0}
        return StageResult(tmp_path / f"{context.seed}.h5", metrics)

    app = typer.Typer()

    @verb(app)
    def body(session: Session, seeds: int = 1) -> None:
        train_seeds(session, seeds, stage, shown=("speed",))

    def invoke(*arguments):
        obj = {"arguments": ["train", *arguments]}
        return CliRunner().invoke(app, list(arguments), obj=obj, prog_name="train")

    return invoke


def test_seeds_are_counted_up_from_the_first(train, trained):
    result = train("--seeds", "3", "--seed", "4", "--json")
    assert trained == [(4, False), (5, False), (6, False)]
    answer = json.loads(result.stdout)
    assert [row["seed"] for row in answer["seeds"]] == [4, 5, 6]
    assert answer["artifact"].endswith("6.h5")
    assert answer["samples"] == 10


def test_one_seed_is_a_flat_answer_and_a_table(train):
    assert "seeds" not in json.loads(train("--json").stdout)
    table = train().stdout
    assert "speed" in table and "0.h5" in table
    assert "loss" not in table


def test_resume_leaves_out_what_is_done_and_begins_what_is_not(train, trained):
    train("--seeds", "4", "--run", "dog")
    trained.clear()
    work = Work({}, 2, RobotRecord("", ""), command="lacoloco train --seeds 4 --run dog")
    RunStore().begin("dog", "train", label="drail-cat-seed2", work=work)
    train("--resume", "--run", "dog")
    assert trained == [(2, True), (3, False)]


def test_resume_without_an_unfinished_version_is_left_to_the_stage(train, trained):
    train("--seeds", "2")
    trained.clear()
    train("--resume")
    assert trained[0] == (0, True)


def test_contexts_differ_in_nothing_but_the_seed():
    session = Session(verb="train", arguments=["train"], run="dog", quiet=True)
    first, second = contexts(session, 2)
    assert (first.seed, second.seed) == (0, 1)
    assert (first.run, first.command) == (second.run, second.command)
