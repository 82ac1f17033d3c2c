import casadi as ca
import numpy as np
import pytest

from lacoloco.pipelines.retargeting.solve.batched import CHUNK, BatchedFunction


@pytest.mark.parametrize("frames", [1, CHUNK - 1, CHUNK, 2 * CHUNK + 5])
def test_any_number_of_frames_and_sparse_matrices(frames):
    x, p = ca.SX.sym("x", 3), ca.SX.sym("p", 2)
    values = ca.vertcat(x[0] * p[0], ca.sin(x[1]) + p[1])
    function = ca.Function("f", [x, p], [values, ca.jacobian(values, x)])
    rng = np.random.default_rng(0)
    many_x, many_p = rng.normal(size=(frames, 3)), rng.normal(size=(frames, 2))
    found, jacobian = BatchedFunction(function)(many_x, many_p)
    assert found.shape == (frames, 2) and jacobian.shape == (frames, 6)
    for t in range(frames):
        expected = [np.array(ca.densify(part)) for part in function(many_x[t], many_p[t])]
        np.testing.assert_allclose(found[t], expected[0].ravel())
        np.testing.assert_allclose(jacobian[t].reshape(3, 2).T, expected[1])
