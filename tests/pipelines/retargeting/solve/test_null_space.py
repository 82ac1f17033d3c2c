import numpy as np

from lacoloco.pipelines.retargeting.solve.null_space import null_space


def test_steps_meet_the_equations_and_multipliers_balance_forces():
    rng = np.random.default_rng(0)
    gradients, gap = rng.normal(size=(7, 9, 6)), rng.normal(size=(7, 6))
    equal = np.arange(6) < rng.integers(0, 7, size=(7, 1))
    equal = rng.permuted(equal, axis=1)
    held = np.array([True, False, False, False, False, False, False])
    space = null_space(gradients, equal, gap, held)
    for t in range(1, 7):
        here = gradients[t][:, equal[t]]
        count = here.shape[1]
        free = space.basis[t][:, count:]
        np.testing.assert_allclose(here.T @ space.particular[t], -gap[t][equal[t]], atol=1e-9)
        np.testing.assert_allclose(here.T @ free, 0.0, atol=1e-12)
        np.testing.assert_allclose(free.T @ free, np.eye(9 - count), atol=1e-12)
    wanted = np.where(equal & ~held[:, None], rng.normal(size=(7, 6)), 0.0)
    force = (gradients @ wanted[..., None])[..., 0]
    np.testing.assert_allclose(space.multipliers(force, 6), wanted, atol=1e-9)
    assert not space.particular[0].any()
