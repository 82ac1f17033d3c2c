import numpy as np
import pytest

from lacoloco.robots.collisions import find_penetrations
from lacoloco.robots.registry import load_robot

SPEC = load_robot("solo12")


def poses(*changes):
    """Default poses, each changed: (index of qpos, value)."""
    rows = np.tile(SPEC.default_qpos(), (len(changes), 1))
    for row, change in zip(rows, changes, strict=True):
        for index, value in change.items():
            row[index] = value
    return rows


def test_a_standing_robot_touches_nothing_but_the_floor_with_its_feet():
    found = find_penetrations(SPEC, poses({}, {2: 1.0}), 1e-3)
    assert (found.floor.max(), found.own.max()) == (0.0, 0.0)
    assert (found.floor_bodies, found.own_pairs) == ((), ())


def test_a_robot_in_the_floor_is_named_by_body_and_depth():
    height = SPEC.default_height()
    found = find_penetrations(SPEC, poses({}, {2: height - 0.3}), 1e-3)
    assert found.floor[0] == 0.0
    assert found.floor[1] > 0.05
    assert "base_link" in found.floor_bodies
    assert not set(found.floor_bodies) & set(SPEC.feet)


def test_legs_through_each_other_are_named():
    """Front abduction joints turned inwards until the legs cross."""
    left, right = (7 + SPEC.joint_names.index(f"{leg}_HAA") for leg in ("FL", "FR"))
    found = find_penetrations(SPEC, poses({2: 1.0}, {2: 1.0, left: -0.7, right: 0.7}), 1e-3)
    assert found.own[0] == 0.0
    assert found.own[1] > 1e-3
    assert any("FL" in pair and "FR" in pair for pair in found.own_pairs)
    assert found.floor.max() == 0.0


def test_depth_of_a_foot_in_the_floor_is_no_body_in_it():
    found = find_penetrations(SPEC, poses({2: SPEC.default_height() - 0.01}), 1e-3)
    assert found.floor.max() == pytest.approx(0.0)
