from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from skinlab.errors import InputError
from skinlab.mechanics.materials.compressibility import kappa_ratio, nu_consistent, nu_from_ratio


@given(st.floats(0, 0.499))
def test_the_paper_exceeds_the_standard_by_two_mu_times(nu):
    difference = kappa_ratio(nu, "paper") - kappa_ratio(nu, "consistent")
    assert difference == pytest.approx(2 * (1 - nu) / (1 + nu), rel=1e-9)


@pytest.mark.parametrize("convention", ["paper", "consistent"])
@given(nu=st.floats(0.01, 0.499))
def test_nu_comes_back_from_its_ratio(convention, nu):
    assert nu_from_ratio(kappa_ratio(nu, convention), convention) == pytest.approx(nu, rel=1e-9)


def test_published_numbers():
    assert 0.03 * kappa_ratio(0.32, "paper") == pytest.approx(0.17757575757575758)
    assert nu_consistent(kappa_ratio(0.26, "paper")) == pytest.approx(0.313, abs=5e-4)
    for nu, factor in ((0.20, 1.50), (0.32, 1.21), (0.48, 1.014)):
        assert kappa_ratio(nu, "paper") / kappa_ratio(nu, "consistent") == pytest.approx(
            factor, abs=0.006
        )


@pytest.mark.parametrize("nu", [0.6, 0.5, -0.1, float("nan"), np.array([0.3, 0.6])])
def test_a_nu_that_no_skin_has_is_refused(nu):
    with pytest.raises(InputError, match="nu must lie in"):
        kappa_ratio(nu, "paper")
