"""What a chain keeps of what is there, and what it runs again."""

import json
from dataclasses import asdict, replace
from importlib import import_module
from types import SimpleNamespace

import numpy as np
import pytest

from lacoloco.datasets.artifact import read_header, write_artifact
from lacoloco.datasets.store import RunStore
from lacoloco.datasets.work import Work
from lacoloco.pipelines.chains import chain, chain_stages, experiments
from lacoloco.pipelines.errors import StageError
from lacoloco.pipelines.robot import record_of
from lacoloco.pipelines.stage import Silent, StageContext, StageResult
from lacoloco.robots.registry import load_robot

TRAINED = ["train-low", "train-high"]
QUICK = ["eval", "export", "play", "play"]
"""Run every time."""


@pytest.fixture
def ran(monkeypatch):
    """Stages that compute nothing, but record what they are made from; the verbs that ran."""
    calls = []

    def fake(name):
        module = import_module(name)
        verb = next(v for v, m in experiments.STAGES.items() if name.endswith(f".{m}"))

        def run(config, context, **inputs):
            calls.append(verb)
            metadata = {"method": "drail-cat", "heads": {"low": {"layout": []}}}
            asked = Work({}, context.seed, record_of(load_robot("solo12")), ())
            if verb in ("generate", *TRAINED):
                asked = module.work(config, context, **inputs)
            elif verb == "eval":
                metadata["best"] = {"policy": str(inputs["policies"][0])}
            directory = context.begin(verb, asked)
            write_artifact(
                directory.file("artifact.h5"),
                "lacoloco/motions" if verb == "generate" else "lacoloco/policy",
                {"a": np.zeros(1)},
                metadata=metadata,
                config=asked.config,
                seed=context.seed,
                robot=asked.robot,
                parents=[one.path for one in asked.inputs or ()],
            )
            return StageResult(directory.complete(), {})

        return SimpleNamespace(run=run, work=getattr(module, "work", None), PRESETS=module.PRESETS)

    monkeypatch.setattr(chain_stages, "import_module", fake)
    monkeypatch.setattr(chain_stages, "summarise", lambda verb, metrics: "")
    return calls


class Heard(Silent):
    def __init__(self):
        self.lines = []

    def say(self, line):
        self.lines.append(line)


@pytest.fixture
def context(tmp_path):
    return StageContext(RunStore(tmp_path / "runs"), "run", progress=Heard(), resume=True)


@pytest.fixture
def go(ran, context):
    """Run the chain with `--resume`; the stages that ran, without those that always do."""

    def run(preset="smoke", **options):
        ran.clear()
        context.progress.lines.clear()
        chain.run("solo12-synthetic", context, preset=preset, **options)
        return [verb for verb in ran if verb not in QUICK]

    return run


def test_what_was_made_the_same_way_is_kept(go, context):
    assert go() == ["generate", *TRAINED]
    assert go() == []
    assert context.progress.lines == []


def test_another_setting_or_preset_runs_the_stage_and_what_follows_again(go, context):
    go()
    changed = {"train-low": {"ppo.gamma": 0.5}}
    assert go(settings=changed) == TRAINED
    low, high = context.progress.lines
    assert low.startswith("train-low 0001 is not kept: ppo.gamma was 0.9")
    assert "is 0.5; running it again as a new version" in low
    assert "train-high 0001 is not kept: the input was" in high
    assert go() == [], "the first ones are still there"
    assert go(settings=changed) == [], "and so are the second ones"
    assert go("gpu") == ["generate", *TRAINED], "a laptop's artifact is none of a GPU's"
    assert len(context.store.all("run", "train-low")) == 3


def test_other_motions_are_learned_from_anew(go, context, ran):
    go()
    directory = context.store.begin("run", "generate")
    old = read_header(context.store.newest("run", "generate"))
    write_artifact(
        directory.file("artifact.h5"),
        old.schema,
        {"a": np.ones(1)},
        metadata=old.metadata,
        config=old.config,
        seed=old.seed,
        robot=old.robot_record,
    )
    directory.complete()
    assert go() == TRAINED


def test_a_high_level_on_a_task_of_ones_own_is_not_taken_for_one_that_reaches(go, context):
    go()
    made = context.store.newest("run", "train-high")
    header = read_header(made)
    own = {"task": {"file": "mine.toml", "text": "[rewards]"}}
    made.unlink()
    write_artifact(
        made,
        header.schema,
        {"a": np.zeros(1)},
        metadata=header.metadata | own,
        config=header.config,
        seed=header.seed,
        robot=header.robot_record,
        parents=[context.store.newest("run", "train-low")],
    )
    assert go() == ["train-high"]
    assert "task file" in context.progress.lines[0]


def test_a_sweeps_trials_compare_robots_settings_and_motions(go, context, renamed_robot, tmp_path):
    go()
    motions = [context.store.newest("run", "generate")]
    asked = {"preset": "smoke", "method": "drail-cat", "settings": None, "robot": None}
    low, high = (context.store.newest("run", stage) for stage in TRAINED)
    found = chain.trained_levels("solo12-synthetic", context, motions=motions, **asked)
    assert found == chain.Levels(low, high, ())
    for changed in (
        {"preset": "gpu"},
        {"settings": {"train-low": {"worlds": 32}}},
        {"method": "gan"},
    ):
        found = chain.trained_levels(
            "solo12-synthetic", context, motions=motions, **{**asked, **changed}
        )
        assert found == chain.Levels(None, None, ()), changed
    only_high = {"settings": {"train-high": {"worlds": 32}}}
    found = chain.trained_levels(
        "solo12-synthetic", context, motions=motions, **{**asked, **only_high}
    )
    assert found == chain.Levels(low, None, ())


def test_motions_of_another_robot_are_not_learned_from(go, context, renamed_robot, tmp_path):
    go()
    other = str(renamed_robot(tmp_path / "robots"))
    with pytest.raises(StageError, match="not of robot 'rover'"):
        chain.train_both(
            "solo12-synthetic", context, preset="smoke", method="drail-cat", robot=other
        )


def test_an_unfinished_stage_goes_on_only_with_its_own_work(context):
    """A chain begins another version; a verb refuses with the difference."""
    robot = record_of(load_robot("solo12"))
    module = import_module("lacoloco.pipelines.track")
    config = module.smoke()
    begun = context.store.begin("run", "track", work=context.work(config, robot, []))
    begun.file("checkpoint.h5").write_text("half")
    other = context.work(replace(config, speed_factors=(1.0,)), robot, [])
    again = replace(context, or_begin=True).begin("track", other)
    assert again.final.name == "0002"
    same = replace(context, or_begin=True).begin("track", context.work(config, robot, []))
    assert (same.final.name, same.file("checkpoint.h5").read_text()) == ("0001", "half")
    assert json.loads(json.dumps(asdict(config)["speed_factors"])) == [1.0, 0.6]
