"""The sizes that every stage comes in."""

from dataclasses import replace
from importlib import import_module

import pytest

from lacoloco.pipelines import generate, train_high, train_low
from lacoloco.pipelines.chains.experiments import STAGES
from lacoloco.pipelines.sim.hierarchical_env import HOLD_STEPS


@pytest.mark.parametrize("module", STAGES.values())
@pytest.mark.parametrize("preset", ["smoke", "laptop", "gpu", "paper"])
def test_an_experiment_finds_every_size_in_every_stage(module, preset):
    presets = import_module(f"lacoloco.pipelines.{module}").PRESETS
    assert presets[preset]() == presets[preset](), "a preset is data"


def test_the_papers_low_level():
    config = train_low.paper()
    assert config.worlds == 4096
    assert config.samples == 917_504_000
    per_iteration = config.worlds * config.ppo.horizon
    assert config.samples / per_iteration == 7000
    assert per_iteration / config.ppo.minibatches == 16384
    assert config.ppo.epochs == 6
    iterations = [round(share * 7000) for share in config.cat_ramp]
    assert iterations == [5000, 7000]


def test_the_papers_high_level():
    config = train_high.paper()
    assert config.decisions * HOLD_STEPS == 1_310_720_000
    assert config.decisions / (config.worlds * config.ppo.horizon) == 2000


def test_the_papers_experts():
    config = generate.paper()
    for expert, iterations in ((config.walk, 2000), (config.reach, 7000)):
        assert expert.samples / (expert.worlds * expert.ppo.horizon) == iterations
        assert expert.worlds * expert.ppo.horizon / expert.ppo.minibatches == 16384
    assert (config.walk_clips, config.reach_clips, config.seconds) == (120, 20, 10.0)


@pytest.mark.parametrize("stage", [train_low, train_high])
def test_wide_presets_change_sizes_only(stage):
    """What the laptop's recipe learns is learned there too: exploration, discount, networks."""
    small = stage.laptop()
    sizes = ("worlds", "samples", "decisions", "cat_ramp", "ase", "ppo")
    for wide in (stage.gpu(), stage.paper()):
        kept = {name: getattr(small, name) for name in sizes if hasattr(small, name)}
        steps = {name: getattr(small.ppo, name) for name in ("horizon", "epochs", "minibatches")}
        assert replace(wide, **kept) == small
        assert replace(wide.ppo, **steps) == small.ppo
        assert wide.ppo != small.ppo
