"""The table of the hardware shift."""

import pytest

from lacoloco.pipelines.errors import StageError
from lacoloco.pipelines.evaluation import hardware_shift
from lacoloco.pipelines.sim.disturbances.config import UNDISTURBED
from lacoloco.pipelines.sim.tasks import load_task


def test_one_thing_is_changed_at_a_time_and_in_the_end_all(solo12):
    task = load_task(solo12, "reach")
    table = hardware_shift.HARDWARE
    changed = {name: row.apply(task) for name, row in table.items()}
    assert changed["undisturbed"] == task and task.disturbances == UNDISTURBED
    assert len(set(map(repr, changed.values()))) == len(table), "no row twice"
    last = table["everything"]
    at_once = {*last.disturbances, *last.randomisation, *last.reset}
    for name, row in table.items():
        if name not in ("undisturbed", "mujoco-warp"):
            changes = {*row.disturbances, *row.randomisation, *row.reset}
            assert changes, name
            assert changes - {"solver"} <= at_once, name
    assert list(table)[-1] == "everything"


def test_rows_are_chosen_by_name():
    assert hardware_shift.rows_here(("payload", "noise")) == ["noise", "payload"]
    with pytest.raises(StageError, match="shift_rows=nois: no such row; use undisturbed, "):
        hardware_shift.rows_here(("nois",))
