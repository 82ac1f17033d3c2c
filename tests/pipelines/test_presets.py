"""The sizes that every stage comes in."""

from dataclasses import replace
from importlib import import_module

import pytest

from lacoloco.pipelines import generate, train_high, train_low
from lacoloco.pipelines.chains.experiments import EXPERIMENTS, STAGES
from lacoloco.pipelines.chains.stage_configs import config_of
from lacoloco.pipelines.sim.hierarchical_env import HOLD_STEPS


@pytest.mark.parametrize("module", STAGES.values())
@pytest.mark.parametrize("preset", ["smoke", "laptop", "gpu", "paper", "paper-method"])
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


def test_the_papers_method_has_its_rates_and_no_part_of_ours():
    low, high = train_low.PRESETS["paper-method"](), train_high.PRESETS["paper-method"]()
    for ppo in (low.ppo, high.ppo):
        assert {ppo.learning_rate, ppo.min_learning_rate, ppo.max_learning_rate} == {2e-5}
        assert ppo.critic_learning_rate == 2e-5
    iterations = [round(2 * share * 7000) for share in low.cat_ramp]
    assert iterations == [10_000, 11_875]
    assert (low.bc_steps, low.restart_probability, low.long_horizon_fraction) == (0, 0, 0)
    assert low.choose_from == 1.0, "only the last policy is a candidate"
    assert (high.skill_dynamics.rounds, high.restart_probability, high.shaped) == (0, 0, False)
    assert (low.latents.min_steps, low.latents.max_steps) == (1, 149)


@pytest.mark.parametrize("verb", ["train-low", "train-high"])
def test_an_experiments_recipe_does_not_change_the_papers_method(verb):
    """The H1's recipe clones its low level; its motions keep the recipe of every preset."""
    stage = {"train-low": train_low, "train-high": train_high}[verb]
    method = "drail-cat"
    config = config_of(EXPERIMENTS["h1-synthetic"], verb, preset="paper-method", method=method)
    assert config == stage.PRESETS["paper-method"]()
    laptop = config_of(EXPERIMENTS["h1-synthetic"], verb, preset="laptop", method=method)
    assert laptop != stage.PRESETS["laptop"]()


@pytest.mark.parametrize("preset", ["gpu", "paper"])
def test_an_experiments_budget_is_the_laptops_alone(preset):
    def config(verb, preset):
        experiment = EXPERIMENTS["h1-synthetic"]
        return config_of(experiment, verb, preset=preset, method="drail-cat")

    low, high = config("train-low", preset), config("train-high", preset)
    assert (
        low.samples == train_low.PRESETS[preset]().samples > config("train-low", "laptop").samples
    )
    assert high.decisions == train_high.PRESETS[preset]().decisions
    assert low.ase.label_weight > 0.0 and high.skill_dynamics.rounds == 8


@pytest.mark.parametrize("missing", [{"expert_rounds": 0}, {"bc_steps": 0}])
def test_nobody_is_held_to_answers_that_no_expert_gives(missing):
    config = config_of(
        EXPERIMENTS["h1-synthetic"], "train-low", preset="laptop", method="drail-cat"
    )
    assert not config.conflict()
    assert "no expert is asked" in replace(config, **missing).conflict()
    free = replace(config.ase, label_weight=0.0)
    assert not replace(config, ase=free, **missing).conflict()
