"""The stages of an experiment and the configs that they get."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from importlib import import_module
from typing import Any

from lacoloco.pipelines.chains.experiments import METHODS, STAGES, Experiment, known

Settings = Mapping[str, Mapping[str, Any]]
"""Verb -> dotted path of a field of its config -> value."""

PAPER_METHOD = "paper-method"
BUDGETS = ("samples", "decisions")
"""What a recipe sets for ``laptop`` alone: the other presets are named for theirs."""
METHOD_STAGES = ("train-low", "train-high")
"""Whose recipe is this project's: under that preset they get the paper's method instead."""


def before_high(experiment: Experiment) -> tuple[str, ...]:
    """The stages that a published low level replaces."""
    return (*experiment.motion_stages, "train-low")


def stages_of(experiment: Experiment) -> tuple[str, ...]:
    """The verbs of a whole chain, in their order."""
    return (*before_high(experiment), "train-high", "eval", "export", "play")


def config_of(experiment: Experiment, verb: str, *, preset: str, method: str) -> Any:
    """The config that a stage of an experiment gets, before any settings.

    Raises:
        StageError: unknown preset or method.
    """
    module = import_module(f"lacoloco.pipelines.{STAGES[verb]}")
    config = known(module.PRESETS, preset, "preset")()
    config = replace(config, **experiment.settings.get(verb, {}))
    if preset != "smoke" and not (preset == PAPER_METHOD and verb in METHOD_STAGES):
        recipe = experiment.recipe.get(verb, {})
        kept = {key: recipe[key] for key in recipe if preset == "laptop" or key not in BUDGETS}
        config = changed(config, kept)
    if verb == "train-low":
        discriminator, constrained = known(METHODS, method, "method")
        ase = replace(config.ase, discriminator=discriminator)
        config = replace(config, cat=constrained, ase=ase)
    if verb == "eval":
        config = replace(config, episodes=min(config.episodes, experiment.episodes))
    if verb == "train-high" and experiment.decisions is not None:
        config = replace(config, decisions=min(config.decisions, experiment.decisions))
    return config


def changed(config: Any, values: Mapping[str, Any]) -> Any:
    """A config with other values in some fields, named by their dotted paths."""
    for path, value in values.items():
        name, _, rest = path.partition(".")
        inner = changed(getattr(config, name), {rest: value}) if rest else value
        config = replace(config, **{name: inner})
    return config
