"""The paper's law by hand, and κ; the rules of all laws are in skinlab/extensions/laws.py."""

from dataclasses import replace

import numpy as np
import pytest

from skinlab.cli.law_options import law_values
from skinlab.errors import InputError
from skinlab.extensions.laws import resists_a_change_of_volume
from skinlab.extensions.rules import BrokenRuleError
from skinlab.mechanics.materials import LAWS, Law, Potential, get_law
from skinlab.mechanics.materials.base import potential_of_j1
from skinlab.mechanics.materials.compressibility import kappa_ratio, nu_consistent, nu_from_ratio
from skinlab.parameters import Nodes, Parameter, Search


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


def stiffness(name, unit="MPa", transform="log"):
    return Parameter(
        name, unit, "m", 1e-3, 1e3, None, 1.0, "s", "log", search=Search(0.1, 9.0, transform)
    )


class NeoHookean(Law):
    """μ/2 (J1 − 3) + K/2 (J − 1)², all of it the law's own."""

    name, formula, source = "own_bulk", "f", "s"
    parameters = (stiffness("mu_MPa"), stiffness("K_MPa", transform="ratio"))

    def half_shear_modulus(self, values):
        return 0.5 * values["mu_MPa"]

    def isochoric(self, i1, i2, j, parameters):
        half, bulk = 0.5 * parameters["mu_MPa"], parameters["K_MPa"]
        shear = potential_of_j1(i1, j, lambda e: (half * e, half + 0.0 * e, 0.0 * e))
        nothing = 0.0 * i1
        others = dict.fromkeys(Potential.__slots__, nothing)
        own = {"energy": 0.5 * bulk * (j - 1) ** 2, "d_j": bulk * (j - 1), "d_j_j": bulk + nothing}
        return shear + Potential(**{**others, **own})


def test_a_law_without_poissons_ratio_resists_volume_by_any_name():
    derived = NeoHookean().derived({"mu_MPa": 0.06, "K_MPa": 0.2}, "paper")
    assert derived["kappa_MPa"] == pytest.approx(0.2)
    assert derived["nu_consistent"] == pytest.approx((3 * 0.2 - 2 * 0.06) / (6 * 0.2 + 2 * 0.06))
    resists_a_change_of_volume(NeoHookean())


def test_the_bulk_modulus_of_any_law_is_its_kappa():
    law = get_law("mooney_rivlin")
    values = law.coefficients(law.named(law.space.from_unit(np.full(len(law.names), 0.4))), "paper")
    assert law.bulk_modulus(values) == pytest.approx(values["kappa_MPa"], rel=1e-9)


def test_a_law_that_volume_costs_nothing_is_no_law():
    class Soft(NeoHookean):
        def isochoric(self, i1, i2, j, parameters):
            return super().isochoric(i1, i2, j, {**parameters, "K_MPa": 0.0})

    with pytest.raises(BrokenRuleError, match="its bulk modulus at rest is 0 MPa"):
        resists_a_change_of_volume(Soft())


def law(**declared):
    return type("Mine", (NeoHookean,), declared)()


def searched(**declared):
    return law(parameters=(replace(stiffness("mu_MPa"), **declared),))


@pytest.mark.parametrize(
    ("one", "says"),
    [
        ({"name": "mine"}, "it is a dict; expected an object of a subclass of"),
        (NeoHookean, "it is the class itself, NeoHookean; expected an object"),
        (law(parameters=()), "expected at least one"),
        (law(parameters=({"name": "x"},)), "expected at least one"),
        (law(parameters=(stiffness("mu_kPa", "kPa"),)), "mu_kPa is in kPa; expected MPa"),
        (
            law(parameters=(stiffness("mu_MPa"), stiffness("K_kPa", "kPa", "linear"))),
            "K_kPa is in kPa; expected MPa, as all stiffness is",
        ),
        (law(parameters=(stiffness("a", ""),)), "its first parameter, a, is in no unit"),
        (law(poisson="v"), "poisson is 'v'; expected one of: mu_MPa, K_MPa, or None"),
        (
            law(parameters=(stiffness("k_MPa"), stiffness("K_MPa", transform="ratio"))),
            "two of its parameters differ in capitals alone, and have one option: k_MPa, K_MPa",
        ),
        (searched(search=Search(0.0, 1.0, "log")), "search begins at 0; log needs more than 0"),
        (searched(search=Search(0.1, 1.0, "lg")), "even in 'lg'; expected linear, log, ratio"),
        (searched(search=Search("a", 1.0, "log")), "search ends at 'a'; expected a number"),
        (searched(axis=Nodes(0.1, 1.0, "5")), "axis has '5' nodes; expected an int above 1"),
        (searched(axis=Nodes(0.1, 1.0, 5.5)), "axis has 5.5 nodes; expected an int above 1"),
        (searched(axis=Nodes(0.1, 1.0, 5, "lg")), "axis is even in 'lg'; expected linear, log"),
        (searched(axis=Nodes(0.0, 1.0, 5, "log")), "axis begins at 0; log needs more than 0"),
    ],
)
def test_what_is_declared_wrongly_is_refused_in_a_sentence(one, says):
    with pytest.raises((TypeError, ValueError), match=says), LAWS.lent(one):
        pass


def test_laws_whose_parameters_differ_in_capitals_share_an_option():
    """It was refused for both: "--mu-mpa is not a parameter of the law, which takes --mu-mpa"."""

    class Capitals(NeoHookean):
        name = "capitals"
        parameters = (stiffness("MU_MPa"), stiffness("K_MPa", transform="ratio"))

    given = {"law_mu_mpa": 0.06, "law_k_mpa": 0.2}
    with LAWS.lent(NeoHookean()), LAWS.lent(Capitals()):
        assert law_values("own_bulk", given) == law_values("capitals", given) == (0.06, 0.2)
