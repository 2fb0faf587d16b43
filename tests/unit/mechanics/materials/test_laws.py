"""The paper's law by hand, and κ; the rules of all laws are in skinlab/extensions/laws.py."""

import numpy as np
import pytest

from skinlab.errors import InputError
from skinlab.mechanics.materials import get_law
from skinlab.mechanics.materials.compressibility import kappa_ratio, nu_consistent, nu_from_ratio


def test_the_papers_law_by_hand():
    i1, i2, j = np.array([3.5]), np.array([3.9]), np.array([1.1])
    parameters = {"X1_MPa": 0.03, "X2_MPa": 1.0, "kappa_MPa": 0.18}
    j1, j2 = j ** (-2 / 3) * i1, j ** (-4 / 3) * i2
    by_hand = 0.03 * (j1 - 3) + (j1 - 3) * (j2 - 3) + 0.09 * (j - 1) ** 2
    found = get_law("extended_neo_hookean").potential(i1, i2, j, parameters).energy
    assert found == pytest.approx(by_hand)


def test_an_unknown_law_is_refused_with_the_known_ones():
    with pytest.raises(InputError, match="extended_neo_hookean"):
        get_law("hookes")


@pytest.mark.parametrize(("nu", "times"), [(0.20, 1.50), (0.32, 1.21), (0.48, 1.014)])
def test_the_papers_kappa_exceeds_the_consistent_one(nu, times):
    paper, consistent = kappa_ratio(nu, "paper"), kappa_ratio(nu, "consistent")
    assert paper - consistent == pytest.approx(2 * (1 - nu) / (1 + nu), rel=1e-12)
    assert paper / consistent == pytest.approx(times, abs=0.006)


@pytest.mark.parametrize("convention", ["paper", "consistent"])
def test_nu_and_kappa_are_inverse(convention):
    nu = np.linspace(0.0, 0.499, 30)
    np.testing.assert_allclose(
        nu_from_ratio(kappa_ratio(nu, convention), convention), nu, atol=1e-9
    )


def test_the_papers_026_is_a_true_0313():
    assert nu_consistent(kappa_ratio(0.26, "paper")) == pytest.approx(0.313, abs=5e-4)


@pytest.mark.parametrize("nu", [0.5, -0.01, np.nan])
def test_nu_out_of_range_is_refused(nu):
    with pytest.raises(InputError):
        kappa_ratio(nu, "paper")
