import numpy as np
import pytest

from lacoloco.pipelines.retargeting.filters import lower_envelope, smooth


def test_smoothing_keeps_constants_and_their_sum():
    assert smooth(np.full((9, 2), 3.0), 1.3) == pytest.approx(3.0)
    impulse = np.zeros(41)
    impulse[20] = 1.0
    blurred = smooth(impulse, 2.0)
    assert blurred.sum() == pytest.approx(1.0)
    assert np.sqrt(blurred @ (np.arange(41) - 20) ** 2) == pytest.approx(2.0, rel=0.02)


def test_smoothing_by_nothing_changes_nothing():
    series = np.random.default_rng(0).normal(size=(5, 3))
    assert smooth(series, 0.0) is series


@pytest.mark.parametrize("reach", [1, 4, 30])
def test_lower_envelope_never_exceeds_the_series(reach):
    series = np.random.default_rng(reach).normal(size=120).cumsum()
    assert (lower_envelope(series, reach) <= series + 1e-12).all()


def test_lower_envelope_bridges_a_leap_and_follows_a_slope():
    time = np.linspace(0, 1, 101)
    slope = 0.1 * time
    leap = slope + np.where(abs(time - 0.5) < 0.1, 0.2, 0.0)
    envelope = lower_envelope(leap, 15)
    np.testing.assert_allclose(envelope, slope, atol=0.1 * 15 / 50 + 1e-9)
    assert np.diff(envelope, 2).max() < 2e-3
