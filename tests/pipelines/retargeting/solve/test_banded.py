import numpy as np
import pytest

from lacoloco.pipelines.retargeting.solve.banded import REACH, BandedMatrix, BandLayout


def random_matrix(frames, n, seed=0):
    """A positive definite one, and the same written out."""
    rng = np.random.default_rng(seed)
    roots = rng.normal(size=(frames, n, n))
    blocks = roots @ roots.transpose(0, 2, 1) + 10 * np.eye(n)
    bands = rng.normal(size=(REACH, frames, n))
    dense = np.zeros((frames * n, frames * n))
    for t in range(frames):
        here = slice(t * n, (t + 1) * n)
        dense[here, here] = blocks[t]
        for k in range(1, min(REACH, frames - 1 - t) + 1):
            there = slice((t + k) * n, (t + k + 1) * n)
            dense[here, there] = dense[there, here] = np.diag(bands[k - 1, t])
    return BandedMatrix(blocks, bands), dense


@pytest.mark.parametrize("frames", [1, 2, 3, 4, 11])
def test_products_are_those_of_the_matrix_written_out(frames):
    matrix, dense = random_matrix(frames, 5)
    x = np.random.default_rng(1).normal(size=(frames, 5))
    np.testing.assert_allclose((matrix @ x).ravel(), dense @ x.ravel())


@pytest.mark.parametrize("frames", [1, 2, 3, 4, 11])
def test_solutions_lie_in_the_span_and_leave_nothing_along_it(frames):
    matrix, dense = random_matrix(frames, 5)
    rng = np.random.default_rng(2)
    basis = np.linalg.qr(rng.normal(size=(frames, 5, 5)))[0]
    active = np.arange(5) >= rng.integers(0, 5, size=(frames, 1))
    right = rng.normal(size=(frames, 5))
    found = matrix.solve_within(right, basis, BandLayout(active))
    coordinates = (basis.transpose(0, 2, 1) @ found[..., None])[..., 0]
    assert np.abs(coordinates[~active]).max(initial=0.0) < 1e-12
    left = right - (dense @ found.ravel()).reshape(frames, 5)
    along = (basis.transpose(0, 2, 1) @ left[..., None])[..., 0]
    assert np.abs(along[active]).max(initial=0.0) < 1e-10


def test_a_matrix_that_is_not_positive_definite_is_refused():
    matrix, _ = random_matrix(6, 4)
    matrix.blocks[3] -= 100 * np.eye(4)
    layout = BandLayout(np.ones((6, 4), dtype=bool))
    with pytest.raises(np.linalg.LinAlgError):
        matrix.solve_within(np.ones((6, 4)), np.tile(np.eye(4), (6, 1, 1)), layout)


def test_what_is_not_a_number_is_refused():
    matrix, _ = random_matrix(6, 4)
    matrix.blocks[3, 0, 0] = np.nan
    layout = BandLayout(np.ones((6, 4), dtype=bool))
    with pytest.raises(np.linalg.LinAlgError):
        matrix.solve_within(np.ones((6, 4)), np.tile(np.eye(4), (6, 1, 1)), layout)
