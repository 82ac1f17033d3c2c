from __future__ import annotations

import json
from dataclasses import asdict, dataclass, field, fields, is_dataclass
from pathlib import Path
from typing import Literal

import pytest

from lacoloco.datasets import old_names, published
from lacoloco.datasets.artifact import read_header
from lacoloco.datasets.errors import ArtifactError
from lacoloco.datasets.old_names import Removed
from lacoloco_cli.overrides import OverrideError, apply_overrides, field_paths, restored


@dataclass(frozen=True)
class Ppo:
    learning_rate: float = 1e-3
    epochs: int = 5
    hidden: tuple[int, ...] = (512, 256)
    clip_range: tuple[float, float] = (0.8, 1.2)
    shares: tuple[tuple[str, float], ...] = ()
    schedule: Literal["fixed", "adaptive"] = "adaptive"

    def __post_init__(self):
        if self.epochs < 1:
            raise ValueError("epochs must be at least 1")


@dataclass(frozen=True)
class Stage:
    samples: int = 3_000_000
    constrained: bool = True
    name: str = "ase"
    log: Path = Path("log")
    limit: float | None = None
    label: str | None = None
    ppo: Ppo = field(default_factory=Ppo)
    tables: dict[str, float] = field(default_factory=dict)


@pytest.mark.parametrize(
    ("assignment", "read", "expected"),
    [
        ("samples=4096", lambda c: c.samples, 4096),
        ("samples=3e6", lambda c: c.samples, 3_000_000),
        ("samples=9_007_199_254_740_993", lambda c: c.samples, 9_007_199_254_740_993),
        ("constrained=false", lambda c: c.constrained, False),
        ("constrained=Yes", lambda c: c.constrained, True),
        ("name=gan=1", lambda c: c.name, "gan=1"),
        ("log=a/b", lambda c: c.log, Path("a/b")),
        ("limit=0.5", lambda c: c.limit, 0.5),
        ("limit=none", lambda c: c.limit, None),
        ("label=none", lambda c: c.label, None),
        ("label=walk", lambda c: c.label, "walk"),
        ("ppo.learning_rate=1e-4", lambda c: c.ppo.learning_rate, 1e-4),
        ("ppo.hidden=64,32,16", lambda c: c.ppo.hidden, (64, 32, 16)),
        ("ppo.hidden=(8,)", lambda c: c.ppo.hidden, (8,)),
        ("ppo.clip_range=[0.9, 1.1]", lambda c: c.ppo.clip_range, (0.9, 1.1)),
        ("ppo.hidden=()", lambda c: c.ppo.hidden, ()),
        ("ppo.shares=(a,1),(b,2)", lambda c: c.ppo.shares, (("a", 1.0), ("b", 2.0))),
        ("ppo.shares=[[a, 1], [b, 2]]", lambda c: c.ppo.shares, (("a", 1.0), ("b", 2.0))),
        ("ppo.shares=((a,1),)", lambda c: c.ppo.shares, (("a", 1.0),)),
        ("ppo.schedule=fixed", lambda c: c.ppo.schedule, "fixed"),
        (" ppo . epochs = 7", lambda c: c.ppo.epochs, 7),
    ],
)
def test_value_is_read_by_the_annotation(assignment, read, expected):
    value = read(apply_overrides(Stage(), [assignment]))
    assert value == expected
    assert type(value) is type(expected)


def test_the_config_given_is_not_changed_and_the_rest_is_kept():
    before = Stage(name="mine", ppo=Ppo(epochs=3))
    after = apply_overrides(before, ["ppo.learning_rate=2e-4", "samples=10"])
    assert before == Stage(name="mine", ppo=Ppo(epochs=3))
    assert after == Stage(name="mine", samples=10, ppo=Ppo(epochs=3, learning_rate=2e-4))


def test_the_last_of_two_settings_wins():
    assert apply_overrides(Stage(), ["samples=1", "samples=2"]).samples == 2


@pytest.mark.parametrize(
    ("assignment", "names"),
    [
        ("sampels=1", ["sampels", "did you mean 'samples'"]),
        ("ppo.learning_rat=1", ["did you mean 'ppo.learning_rate'"]),
        ("learning_rate=1", ["did you mean 'ppo.learning_rate'"]),
        ("pop.epochs=1", ["did you mean 'ppo.epochs'"]),
        ("zzz=1", ["zzz", "keys here: samples, constrained"]),
        ("samples=many", ["samples", "expected int", "'many'"]),
        ("samples=1.5", ["expected int", "'1.5'"]),
        ("samples=inf", ["expected int"]),
        ("ppo.learning_rate=nan", ["expected float"]),
        ("ppo.learning_rate=", ["expected float"]),
        ("constrained=maybe", ["expected true or false", "'maybe'"]),
        ("ppo.schedule=cosine", ["expected one of fixed, adaptive", "'cosine'"]),
        ("ppo.clip_range=1", ["expected 2 values"]),
        ("ppo.hidden=64,big", ["expected int", "'big'"]),
        ("ppo.shares=a,1", ["expected 2 values", "'a'"]),
        ("limit=high", ["float | None", "'high'"]),
        ("ppo=1", ["group", "ppo.learning_rate"]),
        ("samples.more=1", ["'samples' is a value"]),
        ("tables=1", ["tables", "cannot be set here"]),
        ("ppo.epochs=0", ["ppo.epochs=0", "epochs must be at least 1"]),
        ("samples", ["path.to.field=value"]),
        ("=1", ["path.to.field=value"]),
        ("ppo..epochs=1", ["path.to.field=value"]),
    ],
)
def test_mistake_is_refused_in_one_line_that_names_it(assignment, names):
    with pytest.raises(OverrideError) as caught:
        apply_overrides(Stage(), [assignment])
    message = str(caught.value)
    assert "\n" not in message
    for name in names:
        assert name in message


def test_field_paths_lists_every_leaf():
    assert list(field_paths(Ppo())) == [
        "learning_rate",
        "epochs",
        "hidden",
        "clip_range",
        "shares",
        "schedule",
    ]
    assert "ppo.epochs" in set(field_paths(Stage()))


def test_config_comes_back_from_the_json_of_an_artifact():
    config = Stage(samples=7, ppo=Ppo(hidden=(8, 4), shares=(("walk", 0.5), ("dog", 0.5))))
    kept = json.loads(json.dumps(asdict(config), default=str))
    del kept["log"]
    assert restored(Stage(), kept) == config


def test_stored_field_that_is_unknown_is_refused_in_one_line_that_names_it():
    with pytest.raises(ArtifactError) as caught:
        restored(Stage(), {"samples": 7, "ppo": {"epochs": 3, "epoks": 4}}, "old.h5")
    assert str(caught.value).startswith("old.h5.ppo: Ppo has no field 'epoks'; ")
    assert "\n" not in str(caught.value)


def test_old_name_is_read_as_the_new_one(monkeypatch):
    rows = {"Stage": {"steps": "samples", "ppo.rounds": "ppo.epochs"}, "Ppo": {"lr": None}}
    monkeypatch.setattr(old_names, "CONFIG", rows)
    stored = {"steps": 7, "ppo": {"rounds": 3, "lr": 5}}
    assert restored(Stage(), stored) == Stage(samples=7, ppo=Ppo(epochs=3))
    assert stored == {"steps": 7, "ppo": {"rounds": 3, "lr": 5}}


def test_removed_option_is_read_only_at_its_neutral_values(monkeypatch):
    monkeypatch.setattr(old_names, "CONFIG", {"Ppo": {"bold": Removed(0.0, (1, 2))}})
    assert restored(Stage(), {"ppo": {"bold": 0.0}}) == Stage()
    assert restored(Stage(), {"ppo": {"bold": [1, 2]}}) == Stage()
    with pytest.raises(ArtifactError, match=r"Ppo.bold = 0.5: this option was removed; only 0.0"):
        restored(Stage(), {"ppo": {"bold": 0.5}})


def test_published_artifacts_keep_their_configs():
    """Every published file was made by an earlier version; none of its values may be lost."""
    from lacoloco.pipelines.generate import GenerateConfig
    from lacoloco.pipelines.low_level.config import TrainLowConfig
    from lacoloco.pipelines.train_high import TrainHighConfig

    templates = {
        "generate": GenerateConfig(),
        "train-low": TrainLowConfig(),
        "train-high": TrainHighConfig(),
    }
    read = set()
    for name in ("solo12-experts", "solo12-synthetic-low", "solo12-synthetic"):
        path = published.find(name)
        assert path is not None
        header = read_header(path)
        verb = header.command.split()[1]
        config = restored(templates[verb], header.config)
        assert (
            config.worlds == header.config["worlds"] if verb != "generate" else config.reach_clips
        )
        read.add(verb)
    assert read == set(templates)


def test_every_row_of_old_names_leads_to_a_field_of_today():
    """A row whose target was renamed again would be found only by the next old artifact."""
    from lacoloco.pipelines.generate import GenerateConfig
    from lacoloco.pipelines.low_level.config import TrainLowConfig
    from lacoloco.pipelines.train_high import TrainHighConfig

    classes = {}
    pending = [GenerateConfig(), TrainLowConfig(), TrainHighConfig()]
    while pending:
        config = pending.pop()
        classes[type(config).__name__] = set(field_paths(config))
        values = [getattr(config, field.name) for field in fields(config)]
        pending += [value for value in values if is_dataclass(value)]
    for schema, rows in old_names.CONFIG.items():
        if schema in classes:
            news = {new for new in rows.values() if isinstance(new, str)}
            assert news <= classes[schema], schema
