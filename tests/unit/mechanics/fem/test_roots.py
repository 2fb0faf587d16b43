"""What stands in for scipy in the finite elements gives scipy's numbers."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import interpolate, optimize

from skinlab.mechanics.fem.hermite import CubicHermite
from skinlab.mechanics.fem.roots import brentq

FUNCTIONS = {
    "smooth": (lambda x: math.cos(x) - x, 0.0, 2.0),
    "steep": (lambda x: math.exp(20 * x) - 3.0, -5.0, 5.0),
    "kinked": (lambda x: min(7 * x, 1.0) - 0.3, -3.0, 40.0),
    "jump": (lambda x: 1.0 if x > 0.1 else -1.0, 0.0, 1.0),
    "at an end": (lambda x: x - 1.0, 1.0, 2.0),
}


@pytest.mark.parametrize("tolerances", [{}, {"xtol": 1e-14}, {"xtol": 1e-15, "rtol": 1e-14}])
@pytest.mark.parametrize("name", FUNCTIONS)
def test_a_root_is_scipys(name, tolerances):
    f, a, b = FUNCTIONS[name]
    seen, seen_by_scipy = [], []
    root = brentq(lambda x: seen.append(x) or f(x), a, b, **tolerances)
    wanted = optimize.brentq(lambda x: seen_by_scipy.append(x) or f(x), a, b, **tolerances)
    assert root == pytest.approx(wanted, rel=1e-15)
    assert len(seen) == pytest.approx(len(seen_by_scipy), abs=1)


def test_a_root_that_is_not_there_is_refused():
    for f in (lambda x: 1.0, lambda x: math.nan):
        with pytest.raises(ValueError, match="no change of sign between 0 and 1"):
            brentq(f, 0.0, 1.0)


@given(st.lists(st.floats(-3, 3), min_size=2, max_size=9), st.integers(0, 99))
def test_a_curve_through_points_with_slopes_is_scipys(heights, seed):
    rng = np.random.default_rng(seed)
    x = np.cumsum(rng.uniform(0.01, 5, len(heights)))
    slopes = rng.normal(size=len(heights))
    ours, scipys = (
        kind(x, np.array(heights), slopes)
        for kind in (CubicHermite, interpolate.CubicHermiteSpline)
    )
    at = np.concatenate([x, np.linspace(x[0] - 1, x[-1] + 1, 40), [np.nan]])
    for derivative in (0, 1):
        np.testing.assert_allclose(ours(at, derivative), scipys(at, derivative), rtol=1e-13)
    assert ours(float(x[0])).shape == ()
