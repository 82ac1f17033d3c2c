from dataclasses import replace

import numpy as np
import pytest

from lacoloco.datasets import rotations
from lacoloco.datasets.errors import DatasetError
from lacoloco.datasets.mocap import load_bvh, read_bvh
from lacoloco.datasets.samples import DOG_BVH
from lacoloco.pipelines.retargeting.mocap.body_map import body_map, leg_geometry
from lacoloco.pipelines.retargeting.mocap.glitches import without_glitches
from lacoloco.pipelines.retargeting.mocap.reading import Reading
from lacoloco.pipelines.retargeting.validation import check_recording
from lacoloco.robots.registry import load_robot

SPEC = load_robot("solo12")
MAP = body_map(SPEC)
LEGS = leg_geometry(SPEC, MAP)
RAW = read_bvh(DOG_BVH)
PAIRS = MAP.pairs(RAW, LEGS)


def check(reading=None, change=lambda mocap: mocap, **how):
    """What is found about the sample dog, as (name, text)."""
    reading = reading or Reading(pairs=PAIRS)
    found = check_recording(change(reading.apply(RAW)), MAP, LEGS, reading, "dog.bvh", **how)
    return [(finding.name, finding.text) for finding in found]


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
    ((name, warning),) = check(swapped)
    assert name == "sides_swapped"
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
    ((name, warning),) = check(Reading(pairs=PAIRS, fps=10.0))
    assert name == "few_frames"
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


def at_rate(fps):
    return lambda mocap: replace(mocap, fps=fps)


@pytest.mark.parametrize(("fps", "likely"), [(24.0, "50"), (240.0, "60"), (30.0, "50")])
def test_an_implausible_rate_is_named(fps, likely):
    ((name, text),) = check(change=at_rate(fps))
    assert name == "frame_rate"
    assert f"--source-fps {likely}" in text


def test_a_rate_that_a_person_gave_is_not_questioned():
    assert check(Reading(pairs=PAIRS, source_fps=30.0)) == []
    assert Reading(source_fps=30.0).apply(RAW).fps == 30.0


def glitches(change, part=None):
    positions = RAW.positions.copy()
    change(positions)
    return without_glitches(replace(RAW, positions=positions), MAP, part or (0, RAW.frames))


def lies_off(positions):
    positions[90] += [500.0, 0.0, 0.0]


def two_takes(positions):
    positions[:1] += [0.0, 140.0, 0.0]
    positions[600:] += [300.0, 0.0, 0.0]


def test_one_frame_that_lies_off_is_mended():
    mended, found = glitches(lies_off)
    assert [(f.name, f.text.rsplit(": ")[-1]) for f in found] == [("mended", "90")]
    assert np.abs(mended.positions - RAW.positions).max() < 1.0
    assert glitches(lies_off, (100, 200))[1] == [], "another part is used"


def test_jumps_are_named_in_frames_of_the_file_with_the_longest_part_between_them():
    _, (found,) = glitches(two_takes)
    assert found.name == "jump"
    assert "0 to 1, 599 to 600" in found.text
    assert "--trim 1:600" in found.text
    _, (found,) = glitches(two_takes, (500, 650))
    assert "from frame 599 to 600; --trim 500:600" in found.text
    assert glitches(two_takes, (1, 600))[1] == []


def test_a_sound_recording_and_a_single_frame_have_no_glitches():
    assert without_glitches(RAW, MAP, (0, RAW.frames)) == (RAW, [])
    assert without_glitches(RAW.slice(0, 1), MAP, (0, 1))[1] == []


def upright(mocap):
    """The dog as a person: its trunk stands, its front limbs hang and never come to the ground."""
    names, positions = mocap.joint_names, mocap.positions.copy()
    front = [
        i for i, name in enumerate(names) if any(p in name for p in ("Shoulder", "Arm", "Hand"))
    ]
    positions[:, front, 2] += 0.6
    positions[:, front, 0] = positions[:, [names.index("Hips")], 0]
    return replace(mocap, positions=positions)


def test_a_person_is_not_taken_for_a_dog():
    with pytest.raises(DatasetError, match=r"LeftHand_end, RightHand_end never come.*--map"):
        check(change=upright)
    assert [name for name, _ in check(change=upright, own_map=True)] == ["unlike"]


def test_every_recorded_dog_is_sound_and_the_one_with_a_wrong_frame_time_is_named(shared):
    reading = Reading(pairs=PAIRS)
    found = {}
    for path in sorted((shared / "data" / "mocap" / "bvh").glob("D*.bvh")):
        mocap = reading.of(path)
        found[path.stem] = [
            finding.name for finding in check_recording(mocap, MAP, LEGS, reading, path.stem)
        ]
    assert found.pop("Dog_example_zyx_30fps") == ["frame_rate"]
    assert found and not any(found.values())
