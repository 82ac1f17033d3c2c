"""`--show-config`: every key of every stage, and that each is documented."""

from __future__ import annotations

import dataclasses
import json
from dataclasses import dataclass
from importlib import import_module
from typing import Literal

import pytest
from typer.testing import CliRunner

from lacoloco_cli.config_table import documented, keys_of, value_text
from lacoloco_cli.main import app
from lacoloco_cli.overrides import apply_overrides

STAGES = {
    "generate": "generate",
    "retarget": "retarget",
    "track": "track",
    "train-low": "train_low",
    "train-high": "train_high",
    "eval": "evaluate",
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

    speed: float = 0.5
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


@pytest.mark.parametrize("module", STAGES.values())
def test_every_value_is_shown_as_set_reads_it(module):
    config = config_of(module)
    for key in keys_of(config):
        if key.type != "str":  # an empty text is set by nothing after the equals sign
            assert apply_overrides(config, [f"{key.key}={value_text(key.value)}"]) == config


@pytest.mark.parametrize("module", [*STAGES.values(), "switching"])
def test_every_field_is_documented(module):
    assert [key.key for key in keys_of(config_of(module)) if not key.meaning] == []


@pytest.mark.parametrize("module", [*STAGES.values(), "switching"])
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
    assert all({"key", "value", "type", "unit", "meaning"} == set(row) for row in answer["config"])
    assert not (tmp_path / "runs").exists()


def test_values_are_those_after_set():
    shown = CliRunner().invoke(app, ["eval", "--set", "episodes=77", "--show-config"]).stdout
    (line,) = [line for line in shown.splitlines() if line.startswith("episodes ")]
    assert "77" in line and "int" in line
