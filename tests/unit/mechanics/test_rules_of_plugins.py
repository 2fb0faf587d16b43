"""What `skinlab plugins check` asks of a stranger's law and effect: no more than what is right."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from skinlab_example.warm_up import EFFECT as WARM_UP

from skinlab.extensions.effects import (
    it_depends_on_the_suction_alone_where_it_says_so,
    it_says_what_it_is,
)
from skinlab.extensions.laws import derivatives_are_the_energys
from skinlab.extensions.rules import BrokenRuleError
from skinlab.mechanics.effects import EFFECTS, all_effects
from skinlab.mechanics.effects.base import Effect
from skinlab.mechanics.effects.history import depends_on_history, shows_history
from skinlab.mechanics.fem.skin import Prony
from skinlab.mechanics.materials.base import Law, potential_of_j1
from skinlab.parameters import Nodes, Parameter, Search


class VerondaWestmann(Law):
    """W = C1 (exp(C2 (J1 − 3)) − 1) − C1 C2/2 (J2 − 3): large in J1 where it is small in J2."""

    name = "veronda_westmann"
    formula = "W = C1 (exp(C2 (J1 − 3)) − 1) − C1 C2/2 (J2 − 3) + κ/2 (J − 1)²"
    meaning = "C1: stiffness; C2: how fast it stiffens"
    source = "Veronda and Westmann 1970"
    poisson = "nu"
    parameters = (
        Parameter(
            "C1_MPa", "MPa", "stiffness", 1e-4, 10.0, None, 0.01, "1970", "log",
            search=Search(0.002, 0.05, "log"), axis=Nodes(0.002, 0.05, 5, "log"),
        ),
        Parameter(
            "C2", "", "how fast it stiffens", 0.1, 200.0, None, 6.0, "1970", "log",
            search=Search(2.0, 20.0, "log"), axis=Nodes(2.0, 20.0, 5, "log"),
        ),
        Parameter(
            "nu", "", "Poisson's ratio", 0.0, 0.499, None, 0.35, "1970",
            search=Search(0.25, 0.45), axis=Nodes(0.25, 0.45, 4),
        ),
    )  # fmt: skip

    def half_shear_modulus(self, values):
        return 0.5 * values["C1_MPa"] * values["C2"]

    def isochoric(self, i1, i2, j, parameters):
        c1, c2 = parameters["C1_MPa"], parameters["C2"]

        def energy(e):
            growth = np.exp(c2 * e)
            return c1 * (growth - 1.0), c1 * c2 * growth, c1 * c2**2 * growth

        first = potential_of_j1(i1, j, energy)
        b = -0.5 * c1 * c2 * j ** (-4.0 / 3.0)
        return replace(
            first,
            energy=first.energy + b * i2 + 1.5 * c1 * c2,
            d_i2=b,
            d_j=first.d_j - 4.0 / 3.0 * b / j * i2,
            d_i2_j=-4.0 / 3.0 * b / j,
            d_j_j=first.d_j_j + 28.0 / 9.0 * b / j**2 * i2,
        )


def test_a_right_law_of_an_exponential_obeys():
    derivatives_are_the_energys(VerondaWestmann())


@pytest.mark.parametrize("derivative", ["d_i1", "d_i2", "d_j", "d_i1_i1", "d_i2_j", "d_j_j"])
def test_a_wrong_sign_is_found(derivative):
    class Wrong(VerondaWestmann):
        def isochoric(self, i1, i2, j, parameters):
            right = super().isochoric(i1, i2, j, parameters)
            return replace(right, **{derivative: -getattr(right, derivative)})

    with pytest.raises(BrokenRuleError, match=derivative):
        derivatives_are_the_energys(Wrong())


@pytest.mark.parametrize(
    ("name", "unit"), [("bend_per_mm", "1/mm"), ("rise_um_per_s", "µm/s"), ("share_percent", "%")]
)
def test_a_parameters_name_ends_with_its_unit_in_words(name, unit):
    class Of(Effect):
        name = meaning = formula = source = "an_effect"
        parameters = (Parameter("", "", "", 0.0, 1.0, 0.0, 0.5, ""),)

    Of.parameters = (Parameter(name, unit, "a size", 0.0, 1.0, 0.0, 0.5, "an example"),)
    it_says_what_it_is(Of())
    Of.parameters = (Parameter("size", unit, "a size", 0.0, 1.0, 0.0, 0.5, "an example"),)
    with pytest.raises(BrokenRuleError, match="does not end with its unit"):
        it_says_what_it_is(Of())


SIZE = Parameter("size_um", "µm", "a size", 0.0, 9.0, 0.0, 1.0, "an example")


@pytest.mark.parametrize(
    ("declared", "says"),
    [
        ({"low": -math.inf}, "size_um: low is -inf; expected a finite number"),
        ({"high": math.inf}, "size_um: high is inf; expected a finite number"),
        ({"typical": math.nan}, "size_um: typical is nan; expected a finite number"),
        ({"spacing": "log"}, "size_um: low is 0; log needs more than 0"),
        ({"tried": {"speed_um": (1.0,)}}, "its tried has 'speed_um'; expected one of: size_um"),
        ({"tried": {"size_um": ("a",)}}, "its tried of size_um has 'a'; expected 0 to 9"),
        ({"tried": {"size_um": (1.0, 10.0)}}, "its tried of size_um has 10.0; expected 0 to 9"),
        ({"tried": {"size_um": 1.0}}, "its tried of size_um is 1.0; expected numbers"),
    ],
)
def test_an_effect_that_no_search_can_go_through_is_refused(declared, says):
    class Of(Effect):
        name = meaning = formula = source = "an_effect"
        physical = False
        parameters = (SIZE,)

    with EFFECTS.lent(Of()) as one:
        assert one.parameters == (SIZE,)
    Of.tried = declared.pop("tried", {})
    Of.parameters = (replace(SIZE, **declared),)
    with pytest.raises((TypeError, ValueError), match=says), EFFECTS.lent(Of()):
        pass


class Claims(Effect):
    name = meaning = formula = source = "an_effect"
    physical = False
    needs_history = False
    parameters = (SIZE,)


def claims(**overrides):
    return type("Claim", (Claims,), overrides)()


@pytest.mark.parametrize(
    "overrides",
    [
        {"read": lambda self, t, w, v: w + 1e-3 * v["size_um"] * (1.0 - np.exp(-t))},
        {"read_along": lambda self, t, p, w, v: w + 1e-6 * v["size_um"] * np.gradient(p, t)},
        {"when": lambda self, t, v: t - 0.1 * v["size_um"]},
        {"felt": lambda self, path, v: path.late_by(0.1 * v["size_um"])},
        {"change": lambda self, p, v, n: replace(p, prony=(Prony(0.05 * v["size_um"], 1.0),))},
        {"change": lambda self, p, v, n: replace(p, stiffness=1.0 / n)},
    ],
    ids=["time", "rate", "late", "lag", "relaxes", "cycle"],
)
def test_an_effect_of_time_is_found_though_it_says_that_it_is_none(overrides):
    effect = claims(**overrides)
    assert depends_on_history(effect)
    with pytest.raises(BrokenRuleError, match="needs_history is False"):
        it_depends_on_the_suction_alone_where_it_says_so(effect)


def test_an_effect_depends_on_time_unless_it_says_no():
    assert depends_on_history(WARM_UP)
    bent = claims(read=lambda self, t, w, v: w + 1e-3 * v["size_um"] * w**2)
    assert not depends_on_history(bent)
    it_depends_on_the_suction_alone_where_it_says_so(bent)


def test_built_in_effects_that_say_no_depend_on_the_suction_alone():
    own = [one for one in all_effects() if EFFECTS.origin(one.name) is None]
    assert not [one.name for one in own if not one.needs_history and shows_history(one)]
