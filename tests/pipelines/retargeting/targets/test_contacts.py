from dataclasses import replace

import numpy as np
import pytest

from lacoloco.datasets.mocap import load_bvh
from lacoloco.datasets.samples import DOG_BVH, make_dog
from lacoloco.pipelines.retargeting.targets.contacts import (
    ContactRule,
    detect_contacts,
    phases,
    stance_heights,
)

FPS = 60.0
RULE = ContactRule()
BETWEEN = (RULE.land_height + RULE.lift_height) / 2


def paw(height, forward):
    """A paw (T, 1, 3) at these heights and places along x, m."""
    return np.stack([forward, 0 * height, height], axis=-1)[:, None]


def test_a_paw_that_rests_stands_and_a_lifted_one_does_not():
    rest = np.zeros((30, 2, 3))
    rest[:, 1, 2] = 0.2
    contacts = detect_contacts(rest, np.zeros((30, 3)), FPS, RULE)
    assert contacts[:, 0].all()
    assert not contacts[:, 1].any()


def heights(*corners):
    """Heights (20 per corner,) that go from corner to corner in 10 frames and rest there for 10."""
    frames = np.arange(20 * len(corners))
    knots = [20 * i + end for i in range(len(corners)) for end in (0, 9)]
    return np.interp(frames, knots, np.repeat(corners, 2))


def test_hysteresis_keeps_a_paw_that_wobbles_between_the_thresholds():
    height = heights(0.0, BETWEEN, 0.0, 0.2)
    contacts = detect_contacts(paw(height, 0 * height), np.zeros((80, 3)), FPS, RULE)[:, 0]
    assert contacts[:49].all()
    assert not contacts[60:].any()


def test_between_the_thresholds_alone_there_is_no_contact():
    height = heights(0.0, 0.2, BETWEEN, 0.2)
    contacts = detect_contacts(paw(height, 0 * height), np.zeros((80, 3)), FPS, RULE)[:, 0]
    assert contacts[:9].all()
    assert not contacts[20:].any()


def test_a_paw_that_slides_low_over_the_ground_does_not_stand():
    forward = np.arange(60) * 0.02  # 1.2 m/s
    contacts = detect_contacts(paw(0 * forward, forward), np.zeros((60, 3)), FPS, RULE)
    assert not contacts.any()


def test_in_a_gallop_the_same_slide_is_a_contact():
    forward = np.arange(60) * 0.02
    root = np.stack([np.arange(60) * 0.1, np.zeros(60), np.ones(60)], axis=1)  # 6 m/s
    assert detect_contacts(paw(0 * forward, forward), root, FPS, RULE).all()


@pytest.mark.parametrize(("touch", "counts"), [(1, False), (2, True)])
def test_touches_too_short_to_carry_weight_are_dropped(touch, counts):
    paws = np.zeros((60, 4, 3))
    paws[:, 0, 2] = 0.2
    paws[30 : 30 + touch, 0, 2] = 0.0
    whatever_the_speed = replace(RULE, land_speed=100.0, lift_speed=100.0)
    contacts = detect_contacts(paws, np.zeros((60, 3)), FPS, whatever_the_speed)
    assert contacts[30, 0] == counts
    assert contacts[:, 1:].all()


def test_a_paw_held_up_makes_no_ground_of_its_own():
    paws = np.zeros((50, 4, 3))
    paws[:, 3, 2] = 0.3
    assert stance_heights(paws, RULE) == pytest.approx([0, 0, 0, RULE.ground_spread])


def test_phases_are_listed_paw_by_paw():
    contacts = np.array([[1, 0], [1, 1], [0, 1], [1, 0]], dtype=bool)
    assert phases(contacts) == [(0, 0, 2), (0, 3, 4), (1, 1, 3)]


def test_the_gait_of_the_bundled_dog_is_found():
    mocap = load_bvh(DOG_BVH)
    ends = ["LeftHand_end", "RightHand_end", "LeftFoot_end", "RightFoot_end"]
    found = detect_contacts(mocap.keypoints(ends), mocap.keypoints(["Hips"])[:, 0], FPS, RULE)
    planned = make_dog.stance(np.arange(mocap.frames) / mocap.fps)
    agreement = (found == np.stack([planned[end] for end in ends], axis=1)).mean()
    assert agreement > 0.95


@pytest.mark.parametrize(
    ("clip", "frames", "share"),
    [  # stance shares of fore and hind paws measured independently on these recordings
        ("D1_007_KAN01_001", slice(150, 450), (0.55, 0.50)),
        ("D1_009_KAN01_001", slice(400, 500), (0.43, 0.35)),
        ("D1_010_KAN01_002", slice(0, 155), (0.28, 0.24)),
    ],
)
def test_stance_shares_of_recorded_gaits(shared, clip, frames, share):
    mocap = load_bvh(shared / "data/mocap/bvh" / f"{clip}.bvh")
    ends = ["LeftHand_end", "RightHand_end", "LeftFoot_end", "RightFoot_end"]
    found = detect_contacts(mocap.keypoints(ends), mocap.keypoints(["Hips"])[:, 0], FPS, RULE)
    shares = found[frames].mean(0)
    np.testing.assert_allclose(shares.reshape(2, 2).mean(1), share, atol=0.1)
