from __future__ import annotations

import json

import pytest
from typer.testing import CliRunner

from lacoloco.pipelines.chains import chain
from lacoloco.pipelines.chains.chain_stages import Outcome
from lacoloco.pipelines.chains.experiments import EXPERIMENTS
from lacoloco_cli.main import app


def invoke(*arguments):
    return CliRunner().invoke(app, ["run", *arguments])


@pytest.fixture
def asked(monkeypatch, tmp_path):
    """What the chain was asked to do; it does nothing."""
    calls = []

    def run(name, context, **settings):
        calls.append((name, context, settings))
        return [
            Outcome("generate", 61.0, "140 clips", tmp_path / "motions.h5"),
            Outcome("eval", 30.5, "error 3 cm", tmp_path / "eval.h5"),
        ]

    monkeypatch.setattr(chain, "run", run)
    return calls


@pytest.mark.parametrize("name", EXPERIMENTS)
def test_experiment_names_its_run(asked, name):
    assert invoke(name).exit_code == 0
    ((called, context, settings),) = asked
    assert (called, context.run, settings["method"]) == (name, name, "drail-cat")
    assert settings["from_scratch"] is False


def test_a_chain_from_scratch_is_asked_for(asked):
    assert invoke("quickstart", "--from-scratch").exit_code == 0
    assert asked[0][2]["from_scratch"] is True


@pytest.mark.parametrize(
    ("options", "method"),
    [([], "drail-cat"), (["--disc", "gan"], "gan-cat"), (["--no-cat"], "drail"),
     (["--disc", "gan", "--no-cat"], "gan")],
)  # fmt: skip
def test_methods_of_the_paper(asked, options, method):
    invoke("solo12-synthetic", *options)
    assert asked[0][2]["method"] == method


def test_table_ends_with_the_total(asked):
    lines = invoke("quickstart").stdout.splitlines()
    assert lines[0].split() == ["stage", "time", "what", "came", "out", "where", "it", "is"]
    assert "1m01s" in lines[1] and "140 clips" in lines[1] and "motions.h5" in lines[1]
    assert lines[-1].split() == ["total", "1m32s"]


def test_json_has_every_stage(asked):
    answer = json.loads(invoke("quickstart", "--seeds", "2", "--run", "mine", "--json").stdout)
    assert [row["stage"] for row in answer["stages"]] == ["generate", "eval"]
    assert answer["artifact"].endswith("eval.h5")
    assert (answer["run"], answer["experiment"], answer["seconds"]) == ("mine", "quickstart", 91.5)
    assert asked[0][2]["seeds"] == 2


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        ([], "quickstart, solo12-synthetic"),
        (["solo12-dgo"], "did you mean 'solo12-dog'?"),
        (["quickstart", "--disc", "wgan"], "gan or drail"),
    ],
)
def test_what_does_not_exist_is_refused(asked, arguments, said):
    result = invoke(*arguments)
    assert result.exit_code == 2
    assert result.stderr.count("\n") == 1
    assert said in result.stderr
    assert asked == []


def test_settings_name_a_stage_and_are_read_by_the_type_of_its_field(asked):
    typed = ("--set", "train-low.ppo.gamma=0.97", "--set", "eval.episodes=5e1")
    assert invoke("solo12-synthetic", *typed).exit_code == 0
    settings = asked[0][2]["settings"]
    assert settings == {"train-low": {"ppo.gamma": 0.97}, "eval": {"episodes": 50}}
    assert type(settings["eval"]["episodes"]) is int


@pytest.mark.parametrize(
    ("setting", "said"),
    [
        ("train-lo.ppo.gamma=1", "did you mean 'train-low'?"),
        ("track.samples=1", "no stage 'track' here"),
        ("train-low.ppo.gama=1", "--set train-low.ppo.gama: no key 'gama'; did you mean"),
        ("train-low.ppo.gamma=much", "expected float"),
        ("gamma=1", "STAGE.path.to.field=value"),
        ("train-low.cat=false", "use --disc and --cat"),
    ],
)
@pytest.mark.parametrize("many", [(), ("--methods", "all", "--jobs", "2")])
def test_settings_that_fit_no_stage_are_refused_before_anything_starts(asked, setting, said, many):
    result = invoke("solo12-synthetic", "--set", setting, *many)
    assert result.exit_code == 2
    assert result.stderr.count("\n") == 1
    assert said in result.stderr
    assert asked == []


def test_settings_reach_the_trials_of_a_sweep(monkeypatch):
    from lacoloco.pipelines.chains import sweep

    calls = []

    def run_trials(_, variants, *__, **___):
        calls.extend(variants)
        return [], None

    monkeypatch.setattr(sweep, "run_trials", run_trials)
    invoke("solo12-synthetic", "--methods", "gan", "--set", "train-high.ppo.gamma=0.9")
    assert calls[0].settings == {"train-high": {"ppo.gamma": 0.9}}
