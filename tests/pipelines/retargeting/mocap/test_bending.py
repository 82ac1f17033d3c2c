"""Recordings on a bent course."""

from dataclasses import replace

import numpy as np
import pytest

from lacoloco.datasets.errors import DatasetError
from lacoloco.datasets.mocap import Mocap, load_bvh
from lacoloco.datasets.samples import DOG_BVH
from lacoloco.pipelines.retargeting.mocap.bending import bent

FPS, SPEED = 50.0, 0.8
TRUNK, LEFT, RIGHT, PAW = range(4)


def walker(seconds=5.0, start=(0.0, 0.0), direction=(1.0, 0.0)):
    """A trunk that goes straight on with a marker on either side; a paw stands at 2 m, 10 cm to the
    left.
    """
    time = np.arange(round(seconds * FPS)) / FPS
    ahead = np.array([*direction, 0.0])
    left = np.array([-direction[1], direction[0], 0.0])
    trunk = np.array([*start, 0.4]) + SPEED * time[:, None] * ahead
    paw = np.array([*start, 0.0]) + 2.0 * ahead + 0.1 * left
    points = np.stack(
        (trunk, trunk + 0.2 * left, trunk - 0.2 * left, np.broadcast_to(paw, trunk.shape)), axis=1
    )
    # the middle of all nodes is the trunk's, but for the paw: leave it out of the mean by its
    # counterweight
    counter = np.broadcast_to(4 * trunk - points.sum(1) + trunk, trunk.shape)
    return Mocap(
        "walker",
        FPS,
        ("trunk", "left", "right", "paw", "counter"),
        (-1, 0, 0, 0, 0),
        np.concatenate((points, counter[:, None]), 1),
    )


def middle(values):
    """Without what the smoothing of the course sees of its ends."""
    return values[60:-60]


@pytest.mark.parametrize("curvature", [1.0, -1.6])
def test_a_straight_walk_becomes_a_circle(curvature):
    points = bent(walker(), curvature).positions
    heading = points[:, LEFT, :2] - points[:, RIGHT, :2]
    angle = np.unwrap(np.arctan2(heading[:, 1], heading[:, 0]))
    np.testing.assert_allclose(middle(np.gradient(angle, 1 / FPS)), SPEED * curvature, rtol=0.02)
    speed = np.linalg.norm(np.gradient(points[..., :2], 1 / FPS, axis=0), axis=-1)
    for node, beside in ((TRUNK, 0.0), (LEFT, 0.2), (RIGHT, -0.2)):
        np.testing.assert_allclose(
            middle(speed[:, node]), SPEED * (1 - curvature * beside), rtol=0.02
        )
    np.testing.assert_array_equal(points[..., 2], walker().positions[..., 2])


def test_what_stands_is_not_moved():
    paw = bent(walker(), 1.5).positions[:, PAW]
    assert np.linalg.norm(np.ptp(paw, axis=0)) < 1e-9


def test_bends_to_the_left_of_any_direction():
    """The course of a walk along -y from elsewhere is that of one along x, turned and moved."""
    along_x = bent(walker(), 1.5).positions
    other = bent(walker(start=(3.0, -2.0), direction=(0.0, -1.0)), 1.5).positions
    turned = np.stack((along_x[..., 1], -along_x[..., 0], along_x[..., 2]), axis=-1) + [
        3.0,
        -2.0,
        0.0,
    ]
    np.testing.assert_allclose(other, turned, atol=1e-6)


def test_what_goes_nowhere_stays():
    recording = walker()
    still = replace(recording, positions=np.repeat(recording.positions[:1], 20, axis=0))
    np.testing.assert_array_equal(bent(still, 1.5).positions, still.positions)
    np.testing.assert_array_equal(bent(recording, 0.0).positions, recording.positions)
    one = replace(recording, positions=recording.positions[:1])
    np.testing.assert_array_equal(bent(one, 1.5).positions, one.positions)


def test_a_bend_sharper_than_the_animal_is_wide():
    with pytest.raises(DatasetError, match=r"bent by 6/m.*use at most"):
        bent(walker(), 6.0)


def test_a_dog_turns_and_its_paws_do_not_slip_more():
    """The bundled dog turns by the curvature times its way; of its paws' positions no two
    neighbours are torn apart.
    """
    dog = load_bvh(DOG_BVH)
    curved = bent(dog, 1.5)
    fore, hind = (dog.joint_names.index(name) for name in ("LeftShoulder", "LeftUpLeg"))

    def turned(mocap):
        trunk = mocap.positions[:, fore, :2] - mocap.positions[:, hind, :2]
        angle = np.unwrap(np.arctan2(trunk[:, 1], trunk[:, 0]))
        return angle[-1] - angle[0]

    centre = dog.positions[..., :2].mean(1)
    way = np.linalg.norm(np.diff(centre[:: round(dog.fps / 2)], axis=0), axis=1).sum()
    assert turned(curved) - turned(dog) == pytest.approx(1.5 * way, rel=0.15)
    steps, before = (np.linalg.norm(np.diff(m.positions, axis=0), axis=-1) for m in (curved, dog))
    assert (steps < 1.6 * before + 0.002).all()
