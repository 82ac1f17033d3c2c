import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from lacoloco.datasets import rotations
from lacoloco.pipelines.retargeting.alignment import rigid_fit

POINTS = np.array([[0.2, 0.1, 0.0], [0.2, -0.1, 0.0], [-0.2, 0.1, 0.0], [-0.2, -0.1, 0.0]])
numbers = st.floats(-3, 3)


@given(st.tuples(numbers, numbers, numbers), st.tuples(numbers, numbers, numbers))
def test_a_rigid_motion_is_found_again_even_for_points_in_a_plane(position, vector):
    position, quat = np.array([position]), rotations.exp_map(np.array([vector]))
    targets = position[:, None] + rotations.rotate(quat[:, None], POINTS[None])
    found_position, found_quat = rigid_fit(POINTS, targets)
    np.testing.assert_allclose(found_position, position, atol=1e-9)
    moved = found_position[:, None] + rotations.rotate(found_quat[:, None], POINTS[None])
    np.testing.assert_allclose(moved, targets, atol=1e-9)


def test_the_fit_never_mirrors():
    mirrored = POINTS * [1, -1, 1]
    mirrored[:, 2] += [0.05, 0, 0, 0.05]
    _, quat = rigid_fit(POINTS, mirrored[None])
    assert np.linalg.det(rotations.to_matrix(quat)[0]) > 0.99


def test_noise_is_averaged():
    noise = np.random.default_rng(0).normal(scale=0.01, size=(200, 4, 3))
    position, quat = rigid_fit(POINTS, POINTS[None] + noise)
    assert np.abs(position).max() < 0.03
    assert np.linalg.norm(rotations.log_map(quat), axis=1).max() < 0.3
