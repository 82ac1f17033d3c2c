"""`--show-config`: every key of every stage, and that each is documented."""

from __future__ import annotations

import dataclasses
import json
from dataclasses import dataclass
from importlib import import_module
from typing import Annotated, Literal

import pytest
from typer.testing import CliRunner

from lacoloco.datasets.config_values import Within, check_config, fields_of, is_ruled
from lacoloco.datasets.errors import ArtifactError, ConfigError
from lacoloco_cli.config_table import documented, keys_of, value_text
from lacoloco_cli.main import app
from lacoloco_cli.overrides import OverrideError, apply_overrides, restored

STAGES = {
    "generate": "generate",
    "retarget": "retarget",
    "track": "track",
    "train-low": "train_low",
    "train-high": "train_high",
    "eval": "evaluate",
    "switching": "switching",
    "export": "export",
    "play": "play",
}


@dataclass(frozen=True)
class Inner:
    """Something inside.

    Attributes:
        speed: how fast it
            goes [m/s]; never backwards.
        mode: what it does.
    """

    speed: Annotated[float, Within(0, 2)] = 0.5
    mode: Literal["a", "b"] = "a"


@dataclass(frozen=True)
class Outer:
    """Something.

    Attributes:
        limits: lowest and highest [rad].
        label: a name.

    A paragraph: that is no field.
    """

    limits: tuple[float, float] = (0.0, 1.0)
    label: str | None = None
    inner: Inner = dataclasses.field(default_factory=Inner)
    bare: bool = True


def config_of(module):
    return import_module(f"lacoloco.pipelines.{module}").PRESETS["laptop"]()


def test_every_key_has_value_type_unit_and_meaning():
    rows = [(k.key, value_text(k.value), k.type, k.unit, k.meaning) for k in keys_of(Outer())]
    assert rows == [
        ("limits", "0.0,1.0", "(float, float)", "rad", "lowest and highest."),
        ("label", "none", "str or none", "", "a name."),
        ("inner.speed", "0.5", "float", "m/s", "how fast it goes; never backwards."),
        ("inner.mode", "a", "a|b", "", "what it does."),
        ("bare", "true", "bool", "", ""),
    ]
    assert {k.key: k.allowed for k in keys_of(Outer())} == {
        "limits": "2 numbers",
        "label": "a text or none",
        "inner.speed": "a number from 0 to 2",
        "inner.mode": "one of a, b",
        "bare": "true or false",
    }


def configs_in(config):
    """A config and all configs in it."""
    pending = [config]
    while pending:
        config = pending.pop()
        yield config
        values = [getattr(config, field.name) for field in dataclasses.fields(config)]
        pending += [value for value in values if dataclasses.is_dataclass(value)]


EVERY = [*STAGES.values(), "benchmarks.throughput"]


@pytest.mark.parametrize("module", EVERY)
def test_every_field_of_every_stage_has_a_range(module):
    bare = [
        f"{type(config).__name__}.{name}"
        for config in configs_in(config_of(module))
        for name, hint in fields_of(type(config))
        if not dataclasses.is_dataclass(hint) and not is_ruled(hint)
    ]
    assert bare == []


@pytest.mark.parametrize("module", EVERY)
def test_every_preset_keeps_to_the_ranges(module):
    for preset in import_module(f"lacoloco.pipelines.{module}").PRESETS.values():
        check_config(preset())


BAD = [
    ("train_low", "worlds", 0),
    ("train_low", "ppo.horizon", 0),
    ("train_low", "ppo.minibatches", 0),
    ("train_low", "ppo.learning_rate", -1.0),
    ("train_low", "networks.actor", ()),
    ("train_low", "networks.actor", (60_000, 60_000)),
    ("train_low", "networks.activation", "foo"),
    ("train_low", "ase.batch", -5),
    ("train_low", "samples", -5),
    ("train_low", "kl_anneal", (0.0, 0.6, 1.0)),
    ("train_high", "std", (-1.0, 1.0)),
    ("train_high", "skill_dynamics.hold", (5, 4)),
    ("generate", "seconds", float("inf")),
    ("evaluate", "episodes", 0),
    ("evaluate", "friction", (0.9, 0.1)),
    ("play", "seconds", float("inf")),
    ("export", "opset", 3),
    ("retarget", "scale", "huge"),
]


@pytest.mark.parametrize(("module", "key", "value"), BAD)
def test_a_value_out_of_range_is_refused_wherever_it_comes_from(module, key, value):
    from lacoloco.pipelines.chains.stage_configs import changed

    config = config_of(module)
    field = key.rsplit(".", 1)[-1]
    with pytest.raises(OverrideError, match=rf"^--set {key}.*(use |expected )"):
        apply_overrides(config, [f"{key}={value_text(value)}"])
    with pytest.raises(ConfigError, match=rf"^{key}=.*use "):
        check_config(changed(config, {key: value}))
    stored = json.loads(json.dumps(dataclasses.asdict(changed(config, {key: value}))))
    with pytest.raises(ArtifactError, match=rf"^old.h5: .*{field}=.*use "):
        restored(config, stored, "old.h5")


@pytest.mark.parametrize("stored", [{"worlds": "many"}, {"worlds": [1]}, {"ppo": 3}, {"cat": 1}])
def test_a_stored_value_of_another_type_is_refused(stored):
    with pytest.raises(ArtifactError, match=r"old.h5: \w+=.*: use "):
        restored(config_of("train_low"), stored, "old.h5")


def test_what_takes_two_settings_is_checked_after_both():
    config = config_of("train_low")
    both = ["latents.min_steps=200", "latents.max_steps=300"]
    assert apply_overrides(config, both).latents.min_steps == 200
    with pytest.raises(OverrideError, match="latents.min_steps=200: use at most max_steps = 149"):
        apply_overrides(config, both[:1])
    with pytest.raises(OverrideError, match="ppo.minibatches=9: use at most worlds . horizon = 8"):
        apply_overrides(config, ["worlds=2", "ppo.horizon=4", "ppo.minibatches=9"])


def test_an_experiment_with_a_bad_setting_is_refused():
    from lacoloco.pipelines.chains import chain

    settings = {"eval": {"episodes": 0}}
    one = chain.ChainStages(
        chain.EXPERIMENTS["quickstart"], None, "smoke", "drail-cat", [], settings
    )
    with pytest.raises(ConfigError, match="eval.episodes=0: use a whole number from 1"):
        one.config("eval")


@pytest.mark.parametrize("module", STAGES.values())
def test_every_value_is_shown_as_set_reads_it(module):
    config = config_of(module)
    for key in keys_of(config):
        if key.type != "str":  # an empty text is set by nothing after the equals sign
            assert apply_overrides(config, [f"{key.key}={value_text(key.value)}"]) == config


@pytest.mark.parametrize("module", STAGES.values())
def test_every_field_is_documented(module):
    assert [key.key for key in keys_of(config_of(module)) if not key.meaning] == []


@pytest.mark.parametrize("module", STAGES.values())
def test_nothing_is_documented_that_does_not_exist(module):
    pending = [config_of(module)]
    while pending:
        config = pending.pop()
        names = {field.name for field in dataclasses.fields(config)}
        assert set(documented(type(config))) <= names, type(config)
        values = [getattr(config, name) for name in names]
        pending += [value for value in values if dataclasses.is_dataclass(value)]


@pytest.mark.parametrize("verb", STAGES)
def test_a_verb_shows_its_config_and_does_nothing_else(verb, tmp_path, monkeypatch):
    monkeypatch.setenv("LACOLOCO_RUNS", str(tmp_path / "runs"))
    result = CliRunner().invoke(app, [verb, "--preset", "smoke", "--show-config", "--json"])
    assert result.exit_code == 0, result.output
    answer = json.loads(result.stdout)
    assert (answer["verb"], answer["preset"]) == (verb, "smoke")
    assert all(
        {"key", "value", "type", "allowed", "unit", "meaning"} == set(row)
        for row in answer["config"]
    )
    assert not (tmp_path / "runs").exists()


def test_values_are_those_after_set():
    shown = CliRunner().invoke(app, ["eval", "--set", "episodes=77", "--show-config"]).stdout
    (line,) = [line for line in shown.splitlines() if line.startswith("episodes ")]
    assert "77" in line


@pytest.mark.parametrize("verb", STAGES)
def test_the_table_is_as_wide_as_a_page(verb):
    """Every line, every word of every meaning, and what is allowed as a sentence."""
    result = CliRunner().invoke(app, [verb, "--show-config"])
    lines = result.stdout.splitlines()
    assert max(len(line.rstrip()) for line in lines) <= 110
    words = " ".join(lines).split()
    for key in keys_of(config_of(STAGES[verb])):
        assert key.key in words
        assert {*key.meaning.split()[1:-1], *key.allowed.split()[1:-1]} <= set(words), key
