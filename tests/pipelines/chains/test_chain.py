"""The chains: which stages run, on what."""

from types import SimpleNamespace

import numpy as np
import pytest

from lacoloco.datasets import published
from lacoloco.datasets.artifact import write_artifact
from lacoloco.datasets.store import RunStore
from lacoloco.pipelines import generate, train_high, train_low
from lacoloco.pipelines.chains import chain, chain_stages, experiments
from lacoloco.pipelines.stage import Silent, StageContext, StageResult


def write(path, method="drail-cat", best=None):
    return write_artifact(
        path,
        "lacoloco/policy",
        {"a": np.zeros(1)},
        metadata={"method": method, "best": {"policy": str(best)}},
        config={},
        seed=0,
        robot=None,
    )


@pytest.fixture
def ran(monkeypatch):
    """Stages that do nothing but say what they were given: [(verb, inputs)]."""
    calls = []

    def fake(name):
        verb = next(v for v, module in experiments.STAGES.items() if name.endswith(f".{module}"))

        def run(config, context, **inputs):
            calls.append((verb, inputs))
            directory = context.store.begin(context.run, verb)
            write(directory.file("artifact.h5"), best=inputs.get("policies", [None])[0])
            return StageResult(directory.complete(), {})

        return SimpleNamespace(run=run)

    monkeypatch.setattr(chain_stages, "import_module", fake)
    monkeypatch.setattr(chain_stages, "summarise", lambda verb, metrics: "")
    monkeypatch.setattr(chain.ChainStages, "config", lambda *_: None)
    return calls


@pytest.fixture
def folder(tmp_path, monkeypatch):
    folder = tmp_path / "published"
    folder.mkdir()
    monkeypatch.setattr(published, "FOLDER", folder)
    return folder


class Heard(Silent):
    def __init__(self):
        self.lines = []

    def say(self, line):
        self.lines.append(line)


@pytest.fixture
def context(tmp_path):
    return StageContext(RunStore(tmp_path / "runs"), "run", progress=Heard())


WHOLE = [
    "retarget",
    "generate",
    "train-low",
    "train-high",
    "eval",
    "export",
    "play",
    "play",
    "play",
]
SHORT = ["train-high", "eval", "export", "play"]


def verbs(calls):
    return [verb for verb, _ in calls]


def test_without_a_published_low_level_the_whole_chain_runs(ran, folder, context):
    chain.run("quickstart", context, preset="smoke")
    assert verbs(ran) == WHOLE


@pytest.mark.parametrize("name", ["solo12-synthetic-low", "solo12-synthetic"])
def test_quickstart_trains_only_a_high_level_over_a_published_low_one(ran, folder, context, name):
    low = write(folder / f"{name}.h5")
    chain.run("quickstart", context, preset="smoke", seeds=2)
    assert verbs(ran) == ["train-high", *SHORT]
    assert ran[0][1] == ran[1][1] == {"low": low}
    (line,) = context.progress.lines
    assert name in line and "--from-scratch" in line


def test_the_low_level_alone_comes_before_the_one_inside_a_high_level(folder):
    write(folder / "solo12-synthetic.h5")
    low = write(folder / "solo12-synthetic-low.h5")
    experiment = experiments.EXPERIMENTS["quickstart"]
    assert chain.published_low(experiment, "drail-cat") == low


def test_from_scratch_other_motions_and_other_methods_need_the_whole_chain(
    ran, folder, context, tmp_path
):
    write(folder / "solo12-synthetic.h5")
    for options in (
        {"from_scratch": True},
        {"method": "gan"},
        {"mocap": [tmp_path / "dog.bvh"]},
        {"preset": "paper-method"},
    ):
        ran.clear()
        chain.run("quickstart", context, **{"preset": "smoke", **options})
        assert verbs(ran) == WHOLE, options
    assert context.progress.lines == []


def test_experiments_of_the_paper_never_start_from_what_is_published(ran, folder, context):
    write(folder / "solo12-synthetic.h5")
    chain.run("solo12-synthetic", context, preset="smoke")
    assert "train-low" in verbs(ran)


def test_an_experiment_changes_what_the_preset_says(context):
    experiment = experiments.EXPERIMENTS["solo12-dog-reach"]
    planned = chain.ChainStages(experiment, context, "smoke", "gan", [], {})
    generated, low = planned.config("generate"), planned.config("train-low")
    assert (generated.walk_clips, generated.reach_clips) == (0, generate.smoke().reach_clips)
    assert dict(low.skill_shares).keys() == {"dog", "reach"}
    assert planned.config("retarget").augment
    assert low.ase.discriminator == "gan" and low.samples == train_low.smoke().samples


def test_robots_that_fall_have_a_recipe_of_their_own_but_for_the_smallest_preset(context):
    humanoid = experiments.EXPERIMENTS["h1-synthetic"]
    settings = {"train-low": {"ppo.gamma": 0.9}}
    planned = chain.ChainStages(humanoid, context, "laptop", "drail-cat", [], settings)
    low = planned.config("train-low")
    assert low.networks.actor == (512, 256, 128) and low.long_horizon_from == 0.05
    assert low.ppo.gamma == 0.9 and low.ppo.horizon == train_low.laptop().ppo.horizon
    assert low.ase.label_weight > 0.0 and planned.config("train-high").skill_dynamics.rounds == 8
    small = chain.ChainStages(humanoid, context, "smoke", "drail-cat", [], {}).config("train-low")
    assert (small.networks, small.episode_s) == (
        train_low.smoke().networks,
        train_low.smoke().episode_s,
    )


def test_settings_reach_every_stage_and_come_after_preset_and_experiment(context):
    settings = {
        "generate": {"walk_clips": 5},
        "train-low": {"ppo.gamma": 0.5, "samples": 7},
        "eval": {"episodes": 9},
    }
    experiment = experiments.EXPERIMENTS["solo12-dog-reach"]
    planned = chain.ChainStages(experiment, context, "smoke", "gan", [], settings)
    assert planned.config("generate").walk_clips == 5
    assert (planned.config("train-low").ppo.gamma, planned.config("train-low").samples) == (0.5, 7)
    assert planned.config("train-low").ase.discriminator == "gan"
    assert planned.config("eval").episodes == 9
    assert planned.config("train-high") == train_high.smoke()


def test_a_setting_of_the_low_level_is_not_lost_to_a_published_one(ran, folder, context):
    write(folder / "solo12-synthetic.h5")
    chain.run("quickstart", context, preset="smoke", settings={"train-high": {"decisions": 3}})
    assert verbs(ran) == SHORT
    ran.clear()
    chain.run("quickstart", context, preset="smoke", settings={"train-low": {"samples": 3}})
    assert verbs(ran) == WHOLE


def row(method, seed, error):
    return {
        "method": method,
        "seed": seed,
        "ee_error_mean_m": error,
        "contact_violation_pct": 0.1,
        "falls_pct": 0.3,
    }


def test_an_evaluation_of_several_seeds_is_summed_up_by_mean_and_spread_not_by_the_best():
    rows = [row("drail", 0, 0.01), row("drail", 1, 0.03), row("gan", 4, 0.05)]
    metrics = {"rows": rows, "best": rows[0], "summary": {"drail": {}, "gan": {}}}
    several, single = chain_stages.summarise("eval", metrics).split("; ")
    assert several == (
        "drail, mean of 2 seeds: error 2.0 +- 1.4 cm, violation 0.10 %, falls 0.30 %"
    )
    assert single == "gan, seed 4: error 5.0 cm, violation 0.10 %, falls 0.30 %"
