"""Types and rules of config fields, on a small config of our own."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from typing import Annotated, Literal

import pytest

from lacoloco.datasets.config_values import (
    Form,
    Length,
    Rising,
    Within,
    allowed,
    check_config,
    fields_of,
    is_ruled,
)
from lacoloco.datasets.errors import ConfigError


@dataclass(frozen=True)
class Inner:
    rate: Annotated[float, Within(0, 1, above=True)] = 0.5
    low: Annotated[int, Within(1, 9)] = 1
    high: Annotated[int, Within(1, 9)] = 9

    def conflict(self) -> str:
        return "" if self.low <= self.high else f"low={self.low}: use at most {self.high}"


@dataclass(frozen=True)
class Outer:
    count: Annotated[int, Within(1, 4096)] = 7
    ends: Annotated[tuple[float, float], Within(0, 1), Rising()] = (0.2, 0.4)
    widths: Annotated[tuple[int, ...], Length(1, 3), Within(1, 64)] = (8,)
    pairs: Annotated[tuple[tuple[str, Annotated[float, Within(0, 1)]], ...], Length(0, 2)] = ()
    name: Annotated[str, Form(r"|[a-z]+", "small letters")] = ""
    mode: Literal["a", "b"] = "a"
    limit: Annotated[float, Within(0, math.inf)] | None = None
    on: bool = True
    inner: Inner = field(default_factory=Inner)


@pytest.mark.parametrize(
    "changes",
    [
        {},
        {"count": 1},
        {"count": 4096},
        {"ends": (0, 0)},
        {"ends": (1.0, 1.0)},
        {"widths": (1, 64, 2)},
        {"pairs": (("walk", 1.0),)},
        {"name": "abc"},
        {"limit": math.inf},
        {"limit": 0},
        {"inner": Inner(rate=1, low=4, high=4)},
    ],
)
def test_what_is_allowed_passes(changes):
    check_config(replace(Outer(), **changes))


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"count": 0}, "count=0: use a whole number from 1 to 4,096"),
        ({"count": 4097}, "count=4097: use a whole number from 1 to 4,096"),
        ({"count": 2.5}, "count=2.5: use a whole number from 1 to 4,096"),
        ({"count": True}, "count=True: use a whole number from 1 to 4,096"),
        ({"count": "many"}, "count=many: use a whole number from 1 to 4,096"),
        ({"ends": (0.4, 0.2)}, "ends=0.4, 0.2: use 2 numbers from 0 to 1, the lower one first"),
        ({"ends": (0.4,)}, "ends=0.4,: use 2 numbers from 0 to 1, the lower one first"),
        ({"ends": [0.2, 0.4]}, "ends=[0.2, 0.4]: use 2 numbers from 0 to 1, the lower one first"),
        ({"widths": ()}, "widths=: use 1 to 3 whole numbers from 1 to 64"),
        ({"widths": (8, 0)}, "widths=8, 0: use 1 to 3 whole numbers from 1 to 64"),
        ({"widths": (8,) * 4}, "widths=8, 8, 8, 8: use 1 to 3 whole numbers from 1 to 64"),
        ({"pairs": (("walk", 1.1),)}, "use 0 to 2 times (a text, a number from 0 to 1)"),
        ({"name": "Abc"}, "name=Abc: use small letters"),
        ({"mode": "c"}, "mode=c: use one of a, b"),
        ({"limit": -1.0}, "limit=-1.0: use a number from 0 or none"),
        ({"limit": math.nan}, "limit=nan: use a number from 0 or none"),
        ({"on": 1}, "on=1: use true or false"),
        ({"inner": {"rate": 1}}, "use a group of fields"),
        ({"inner": Inner(rate=0)}, "inner.rate=0: use a number above 0, at most 1"),
        ({"inner": Inner(low=5, high=4)}, "inner.low=5: use at most 4"),
    ],
)
def test_what_is_not_allowed_is_named_with_value_and_range(changes, message):
    with pytest.raises(ConfigError) as caught:
        check_config(replace(Outer(), **changes))
    assert message in str(caught.value)


def test_a_long_value_is_shortened():
    with pytest.raises(ConfigError) as caught:
        check_config(Outer(widths=(0,) * 10_000))
    assert len(str(caught.value)) < 200


def test_a_field_without_rules_is_told_from_one_with():
    ruled = {name: is_ruled(hint) for name, hint in fields_of(Outer) if name != "inner"}
    assert all(ruled.values())
    assert not any(is_ruled(hint) for hint in (int, str, float | None, tuple[int, ...]))


def test_ranges_are_said_as_in_use_a_number():
    said = {name: allowed(hint) for name, hint in fields_of(Inner)}
    assert said == {
        "rate": "a number above 0, at most 1",
        "low": "a whole number from 1 to 9",
        "high": "a whole number from 1 to 9",
    }
