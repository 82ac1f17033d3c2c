"""What is said of clips that look perfect in their figures and are not."""

from dataclasses import replace

import numpy as np
import pytest

from lacoloco.datasets import rotations
from lacoloco.datasets.mocap import load_bvh
from lacoloco.datasets.samples import DOG_BVH
from lacoloco.pipelines.retargeting.retargeter import Retargeter
from lacoloco.pipelines.retargeting.solve.clip_problem import ClipWeights
from lacoloco.robots.registry import load_robot


@pytest.fixture(scope="module")
def found():
    retargeter = Retargeter(load_robot("solo12"), "clip", "", 0.005, ClipWeights())
    return lambda mocap: [f.name for f in retargeter.clip(mocap, "clip").assessment.findings()]


def dog():
    return load_bvh(DOG_BVH).slice(0, 120)


def test_a_walking_dog_gives_none(found):
    assert found(dog()) == []


def test_a_floor_that_tilts_along_the_course_leaves_nothing_standing(found):
    quat = np.array([np.cos(0.05), 0.0, np.sin(0.05), 0.0])
    tilted = replace(dog(), positions=rotations.rotate(quat[None, None], dog().positions))
    assert "nothing_stands" in found(tilted)


def test_a_root_that_does_not_move_leaves_nothing_standing(found):
    level = dog().positions[:, :1] * [1.0, 1.0, 0.0]
    assert "nothing_stands" in found(replace(dog(), positions=dog().positions - level))


def test_a_gallop_at_a_robots_size_is_not_carried(found, shared):
    gallop = load_bvh(shared / "data" / "mocap" / "bvh" / "D1_010_KAN01_002.bvh")
    assert found(gallop)[0] == "not_carried"


def test_thighs_of_a_sitting_dog_are_found_in_the_floor(found, shared):
    sitting = load_bvh(shared / "data" / "mocap" / "bvh" / "D1_045_KAN01_001.bvh").slice(400, 700)
    assert "body_contact" in found(sitting)
