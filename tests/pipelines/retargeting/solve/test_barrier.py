import numpy as np
import pytest

from lacoloco.pipelines.retargeting.solve.barrier import TO_BOUNDARY, Barrier, longest_step

LOWER = np.array([-1.0, -np.inf, 0.0, -np.inf])
UPPER = np.array([1.0, 2.0, np.inf, np.inf])
ROWS = np.array([0.5, 2.5, 0.2, 7.0])


def test_slacks_are_the_distances_and_positive_where_bounds_are_broken():
    barrier = Barrier(LOWER, UPPER, 1e-3, ROWS)
    np.testing.assert_allclose(barrier.distances(ROWS), [1.5, 0.2, 0.5, -0.5])
    np.testing.assert_allclose(barrier.slacks, [1.5, 0.2, 0.5, 0.01])
    assert (barrier.multipliers > 0).all()


def test_slacks_fit_between_bounds_that_are_close():
    barrier = Barrier(np.array([0.0]), np.array([0.02]), 1e-3, np.array([5.0]))
    assert (barrier.slacks >= 0.005).all() and barrier.slacks.min() == 0.005


def test_a_step_brings_slacks_to_the_distances_and_products_to_mu():
    barrier, change = Barrier(LOWER, UPPER, 1e-3, ROWS), np.array([0.1, -0.6, 0.1, 3.0])
    slacks, multipliers = barrier.step(ROWS, change)
    np.testing.assert_allclose(barrier.slacks + slacks, barrier.distances(ROWS + change))
    linearised = barrier.slacks * (barrier.multipliers + multipliers) + barrier.multipliers * slacks
    np.testing.assert_allclose(linearised, 1e-3)


def test_the_condensed_rows_push_as_the_new_multipliers_do():
    barrier, change = Barrier(LOWER, UPPER, 1e-3, ROWS), np.array([0.1, -0.6, 0.1, 3.0])
    stiffness, force = barrier.condensed(ROWS)
    _, multipliers = barrier.step(ROWS, change)
    barrier.multipliers = barrier.multipliers + multipliers
    np.testing.assert_allclose(force - stiffness * change, -barrier.outward())
    assert stiffness[3] == force[3] == 0.0


def test_steps_end_before_a_value_vanishes():
    values = np.array([1.0, 2.0])
    assert longest_step(values, np.array([-4.0, 1.0])) == pytest.approx(TO_BOUNDARY / 4)
    assert longest_step(values, np.array([0.5, 1.0])) == 1.0
    assert longest_step(np.zeros(0), np.zeros(0)) == 1.0
