"""Which policy of a run a verb takes."""

import numpy as np
import pytest

from lacoloco.datasets import provenance
from lacoloco.datasets.artifact import write_artifact
from lacoloco.datasets.store import RunStore
from lacoloco_cli.policy_choice import best
from lacoloco_cli.session import Session


@pytest.fixture
def add(monkeypatch):
    """Complete a version of a stage at a given time of the clock."""

    def factory(stage, clock, schema="lacoloco/policy", parents=(), **metadata):
        monkeypatch.setattr(provenance, "timestamp", lambda: clock)
        directory = RunStore().begin("dog", stage)
        write_artifact(
            directory.file("artifact.h5"),
            schema,
            {"a": np.arange(2.0)},
            metadata=metadata,
            config={},
            seed=0,
            robot=None,
            parents=parents,
        )
        return directory.complete()

    return factory


CLOCKS = {"forward": ("2026-01-01", "2026-01-02", "2026-01-03", "2026-01-04")}
CLOCKS["back"] = CLOCKS["forward"][::-1]
CLOCKS["still"] = ("2026-01-01",) * 4


@pytest.mark.parametrize("clock", CLOCKS)
def test_the_evaluated_best_is_taken_until_a_newer_policy_is_there(add, clock):
    """Whatever the clock does: versions and parents tell what was there first."""
    times, session = iter(CLOCKS[clock]), Session("export", run="dog")
    first, second = (add("train-high", next(times)) for _ in range(2))
    assert best(session) == second
    rows = [{"seed": 0}, {"seed": 1}]
    evaluated = {"parents": [first, second], "rows": rows, "best": rows[0]}
    add("eval", next(times), "lacoloco/evaluation", **evaluated)
    assert best(session) == first
    third = add("train-high", next(times))
    assert best(session) == third, "no evaluation has seen it"
