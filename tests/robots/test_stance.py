"""Does a robot stand when its motors hold the default pose?"""

from dataclasses import replace

import pytest

from lacoloco.robots.check import check_robot
from lacoloco.robots.loading import robot_from_files
from lacoloco.robots.stance import stand


def test_stiffer_legs_sag_less(solo12):
    soft, stiff = (
        stand(replace(solo12, stiffness=(k,) * 12, damping=(0.05 * k,) * 12), seconds=2.0)
        for k in (4.0, 16.0)
    )
    assert (soft.fell, stiff.fell) == ("", "")
    assert 0.0 < stiff.sag < 0.25 * soft.sag < 0.25
    assert stiff.height == pytest.approx(solo12.default_height())
    assert stiff.qpos[2] == pytest.approx((1.0 - stiff.sag) * stiff.height)
    # each leg holds a quarter of the weight, at a knee that is 0.065 m from above its foot
    assert 0.05 < stiff.effort < 0.3


def test_legs_without_strength_are_found_by_the_check(solo12):
    limp = replace(solo12, stiffness=(0.1,) * 12)
    (check,) = check_robot(limp, poses=2).failures()
    assert "joints: stiffness: expected gains that hold the default pose for 10 s" in check.problem
    assert "base_link touches the floor" in check.problem
    assert check_robot(replace(limp, gait=object()), poses=2).failures() == ()


def test_physics_that_diverges_ends(solo12):
    wild = replace(solo12, stiffness=(1e9,) * 12, damping=(1e-3,) * 12)
    files = {name: text.replace('"-3 3"', '"-1e9 1e9"') for name, text in wild.files().items()}
    wild = replace(robot_from_files(files), stiffness=wild.stiffness, damping=wild.damping)
    stance = stand(wild, seconds=1.0)
    assert stance.fell and stance.seconds < 1.0
