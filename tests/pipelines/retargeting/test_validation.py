from dataclasses import replace

import numpy as np
import pytest

from lacoloco.datasets import rotations
from lacoloco.datasets.errors import DatasetError
from lacoloco.datasets.mocap import load_bvh, read_bvh
from lacoloco.datasets.samples import DOG_BVH
from lacoloco.pipelines.retargeting.mocap.body_map import body_map, leg_geometry, side_partners
from lacoloco.pipelines.retargeting.mocap.reading import Reading, limb_pairs
from lacoloco.pipelines.retargeting.validation import check_recording
from lacoloco.robots.registry import load_robot

SPEC = load_robot("solo12")
MAP = body_map(SPEC)
LEGS = leg_geometry(SPEC, MAP)
RAW = read_bvh(DOG_BVH)
PAIRS = limb_pairs(MAP.limbs(RAW), side_partners(LEGS))


def check(reading=None, change=lambda mocap: mocap):
    reading = reading or Reading(pairs=PAIRS)
    return check_recording(change(reading.apply(RAW)), MAP, LEGS, reading, "dog.bvh")


def turned(angle, axis):
    quat = np.array([np.cos(angle / 2), *(np.sin(angle / 2) * np.array(axis))])
    return lambda mocap: replace(
        mocap, positions=rotations.rotate(quat[None, None], mocap.positions)
    )


def test_a_dog_on_its_legs_is_fine():
    assert check() == []
    assert check(Reading(pairs=PAIRS, mirror=True)) == []
    assert check(change=turned(2.0, [0, 0, 1])) == []


@pytest.mark.parametrize(
    ("unit", "words"),
    [
        (1.0, "limbs of 47.* centimetres: give --unit 0.01"),
        (0.0001, "centimetres: give --unit 0.01 instead of 0.0001"),
    ],
)
def test_the_wrong_unit_is_named(unit, words):
    with pytest.raises(DatasetError, match=words):
        check(Reading(unit=unit, pairs=PAIRS))


def test_a_file_in_metres_read_as_centimetres_is_named():
    metres = replace(RAW, positions=0.01 * RAW.positions)
    reading = Reading(pairs=PAIRS)
    with pytest.raises(DatasetError, match="in metres: give --unit 1 instead of 0.01"):
        check_recording(reading.apply(metres), MAP, LEGS, reading, "dog.bvh")


@pytest.mark.parametrize(
    ("read_with", "words"),
    [
        ("-y", "upside down.* give --up-axis=y"),
        ("z", "on its side.*give --up-axis=y"),
        ("-x", "on its side.*give --up-axis=y"),
    ],
)
def test_the_wrong_axis_is_named_with_the_right_one(read_with, words):
    with pytest.raises(DatasetError, match=words):
        check(Reading(up_axis=read_with, pairs=PAIRS))


def test_exchanged_sides_are_a_warning_and_can_be_mended():
    swapped = Reading(pairs=PAIRS, swap_sides=True)
    (warning,) = check(swapped)
    assert "left and right" in warning and "--swap-sides" in warning
    # a file whose names are exchanged, read with the option
    wrong = replace(RAW, positions=swapped.apply(RAW).positions)
    mended = Reading(up_axis="z", unit=1.0, pairs=PAIRS, swap_sides=True)
    assert check_recording(mended.apply(wrong), MAP, LEGS, mended, "dog.bvh") == []


def test_a_dog_that_rolls_over_for_a_while_is_let_through():
    def rolling(mocap):
        angle = np.pi * np.sin(np.linspace(0, np.pi, mocap.frames)) ** 4
        quat = np.stack([np.cos(angle / 2), np.sin(angle / 2), 0 * angle, 0 * angle], axis=1)
        return replace(mocap, positions=rotations.rotate(quat[:, None], mocap.positions))

    assert check(change=rolling) == []


def test_a_single_frame_is_no_motion():
    with pytest.raises(DatasetError, match=r"dog\.bvh: has one frame"):
        check(change=lambda mocap: mocap.slice(0, 1))


def test_few_frames_per_second_are_a_warning():
    (warning,) = check(Reading(pairs=PAIRS, fps=10.0))
    assert "10 frames per second" in warning


def test_the_order_of_trim_and_rate():
    reading = Reading(pairs=PAIRS, trim="60:121", fps=30.0)
    part = reading.apply(RAW)
    assert (part.frames, part.fps) == (31, 30.0)
    start = load_bvh(DOG_BVH).positions[60]
    np.testing.assert_allclose(part.positions[0], start, atol=1e-9)


def test_pairs_hold_whole_limbs():
    assert ("LeftArm", "RightArm") in PAIRS
    assert ("LeftFoot_end", "RightFoot_end") in PAIRS
    assert len(PAIRS) == 9
