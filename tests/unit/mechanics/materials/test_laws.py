"""Every law that is found in the folder, by the same rules."""

import numpy as np
import pytest

from skinlab.errors import InputError
from skinlab.mechanics.materials import get_law, law_names
from skinlab.mechanics.materials.compressibility import kappa_ratio, nu_consistent, nu_from_ratio

ANY = {
    "X1_MPa": 0.03,
    "X2_MPa": 1.0,
    "X3_MPa": 50.0,
    "C10_MPa": 0.5,
    "C01_MPa": 0.1,
    "kappa_MPa": 0.18,
}
FIRST = ("d_i1", "d_i2", "d_j")
SECOND = {
    "d_i1": ("d_i1_i1", "d_i1_i2", "d_i1_j"),
    "d_i2": ("d_i1_i2", "d_i2_i2", "d_i2_j"),
    "d_j": ("d_i1_j", "d_i2_j", "d_j_j"),
}


@pytest.mark.parametrize("name", law_names())
def test_a_law_says_what_it_is(name):
    law = get_law(name)
    assert law.name == name
    assert law.source
    assert len(set(law.parameter_names)) == len(law.parameter_names)


@pytest.mark.parametrize("name", law_names())
def test_no_energy_and_no_stress_at_rest(name):
    p = get_law(name).potential(np.array([3.0]), np.array([3.0]), np.array([1.0]), ANY)
    assert p.energy[0] == pytest.approx(0.0, abs=1e-15)
    # S = 2 ∂W/∂C = (2 W1 + 4 W2 + W_J) 1 there
    assert 2 * p.d_i1[0] + 4 * p.d_i2[0] + p.d_j[0] == pytest.approx(0.0, abs=1e-14)


@pytest.mark.parametrize("name", law_names())
def test_derivatives_by_the_invariants(name):
    law = get_law(name)
    rng = np.random.default_rng(0)
    at = [3.2 + rng.uniform(0, 1, 20), 3.3 + rng.uniform(0, 1, 20), rng.uniform(0.5, 1.6, 20)]
    here = law.potential(*at, ANY)
    h = 1e-5
    for k, first in enumerate(FIRST):
        up, down = ([x + s * h * (i == k) for i, x in enumerate(at)] for s in (1, -1))
        up, down = law.potential(*up, ANY), law.potential(*down, ANY)
        np.testing.assert_allclose(
            (up.energy - down.energy) / (2 * h), getattr(here, first), rtol=1e-6, atol=1e-8
        )
        for of, column in SECOND.items():
            slope = (getattr(up, of) - getattr(down, of)) / (2 * h)
            np.testing.assert_allclose(slope, getattr(here, column[k]), rtol=1e-6, atol=1e-7)
        for field in (first, *SECOND[first]):
            assert getattr(here, field).shape == (20,)


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
