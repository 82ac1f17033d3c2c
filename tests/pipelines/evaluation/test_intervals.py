"""Intervals over episodes and over seeds."""

import numpy as np
import pytest

from lacoloco.pipelines.evaluation import intervals


def test_quantiles_of_student():
    """Against the distribution itself: the integral of its density over +-q is 95 %."""
    for degrees in (1, 2, 4, 30, 31, 100):
        edge = intervals.t_quantile(degrees)
        x = np.linspace(-edge, edge, 200_001)
        density = (1 + x**2 / degrees) ** (-(degrees + 1) / 2)
        far = np.tan(np.linspace(-np.pi / 2, np.pi / 2, 2_000_001)[1:-1])  # x = tan(a), whole line
        whole = np.trapezoid(
            (1 + far**2 / degrees) ** (-(degrees + 1) / 2) * (1 + far**2), np.arctan(far)
        )
        assert np.trapezoid(density, x) / whole == pytest.approx(0.95, abs=2e-4), degrees


def test_over_seeds_by_hand():
    assert intervals.over_seeds([1.0]) is None
    low, high = intervals.over_seeds([1.0, 2.0, 3.0])
    assert (low, high) == pytest.approx((2 - 4.303 / 3**0.5, 2 + 4.303 / 3**0.5))
    assert intervals.over_seeds([99.0, 97.0], (0.0, 100.0)) == pytest.approx([98 - 12.706, 100])


def test_a_unanimous_share_is_not_certain():
    assert intervals.unanimous(True, 10) == pytest.approx([69.15, 100.0], abs=0.01)
    assert intervals.unanimous(False, 10) == pytest.approx([0.0, 30.85], abs=0.01)
