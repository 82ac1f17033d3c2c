import numpy as np
import pytest

from lacoloco.pipelines.retargeting.measure.contact_forces import FRICTION, distribute

CORNERS = np.array([[0.2, 0.1, 0.0], [0.2, -0.1, 0.0], [-0.2, 0.1, 0.0], [-0.2, -0.1, 0.0]])


def maps(points):
    """Force and moment about the origin of a force at each point, (1, 6, F, 3)."""
    cross = [[[0, -z, y], [z, 0, -x], [-y, x, 0]] for x, y, z in points]
    return np.concatenate([np.tile(np.eye(3), (len(points), 1, 1)), np.array(cross)], axis=1)[
        None
    ].transpose(0, 2, 1, 3)


def solve(force, moment=(0, 0, 0), stands=(True,) * 4):
    wrench = np.array([[*force, *moment]], dtype=float)
    return distribute(maps(CORNERS), wrench, np.array([stands]))[0]


def test_a_weight_in_the_middle_is_shared_evenly():
    np.testing.assert_allclose(solve([0, 0, 4]), np.tile([0, 0, 1.0], (4, 1)), atol=2e-3)


def test_a_diagonal_pair_carries_alone():
    forces = solve([0, 0, 4], stands=(True, False, False, True))
    np.testing.assert_allclose(forces[[1, 2]], 0.0)
    np.testing.assert_allclose(forces[[0, 3], 2], 2.0, atol=5e-3)


def test_the_moment_decides_who_carries_more():
    forces = solve([0, 0, 4], moment=[0.1, 0, 0])  # about x: towards the left
    assert forces[[0, 2], 2].sum() - forces[[1, 3], 2].sum() == pytest.approx(1.0, abs=0.02)


def test_the_ground_does_not_pull():
    np.testing.assert_allclose(solve([0, 0, -4]), 0.0, atol=1e-9)


def test_friction_bounds_what_the_ground_can_hold():
    forces = solve([10, 0, 1])
    assert (np.abs(forces[:, :2]).sum(1) <= FRICTION * forces[:, 2] + 1e-9).all()
    assert (forces[:, 2] >= 0).all()


def test_nobody_stands():
    assert not solve([0, 0, 4], stands=(False,) * 4).any()
