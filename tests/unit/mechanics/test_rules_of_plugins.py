"""What `skinlab plugins check` asks of a stranger's law and effect: no more than what is right."""

from __future__ import annotations

import math
import os
import warnings
from dataclasses import replace

import numpy as np
import pytest
from skinlab_example.warm_up import EFFECT as WARM_UP

from skinlab import plugins
from skinlab.curves.pressure_path import PressurePath
from skinlab.errors import BrokenPluginError
from skinlab.extensions.effects import (
    a_learned_one_has_a_function,
    it_depends_on_the_suction_alone_where_it_says_so,
    it_says_what_it_is,
)
from skinlab.extensions.laws import derivatives_are_the_energys
from skinlab.extensions.rules import BrokenRuleError
from skinlab.mechanics.effects import EFFECTS, all_effects
from skinlab.mechanics.effects.base import Effect, check_effect
from skinlab.mechanics.effects.history import depends_on_history, shows_history
from skinlab.mechanics.effects.model import Sensors, felt_path, problem_of, solve_skin
from skinlab.mechanics.effects.strain_stiffening import CUBIC
from skinlab.mechanics.fem.skin import Layer, Prony, Skin, Term
from skinlab.mechanics.fem.suction import Geometry
from skinlab.mechanics.materials.base import Law, potential_of_j1
from skinlab.mechanics.materials.checked import small_strains
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


class InPlace(Effect):
    name = meaning = formula = source = "in_place"
    physical = False
    parameters = (SIZE,)

    def when(self, time_s, values):
        time_s -= 0.1
        return time_s

    def read_along(self, since_s, pressure_mbar, deflection_mm, values):
        pressure_mbar /= 10.0
        values["size_um"] *= 1e-3
        deflection_mm += values["size_um"] * pressure_mbar
        return deflection_mm


def test_what_an_installed_effect_changes_in_place_is_its_own(monkeypatch):
    monkeypatch.setitem(EFFECTS._all(), "in_place", InPlace())
    monkeypatch.setitem(EFFECTS._origins, "in_place", plugins.Origin("works", "1.0"))
    sensors = Sensors.of({"in_place": {"size_um": 2.0}})
    time, pressure, deflection = np.arange(3.0), np.full(3, 50.0), np.ones(3)
    for _ in range(2):
        assert sensors.when(time) == pytest.approx(np.arange(3.0) - 0.1)
        assert sensors.read(time, pressure, deflection, 0.0) == pytest.approx(np.full(3, 1.01))
    assert [*time, *pressure, *deflection] == [0, 1, 2, 50, 50, 50, 1, 1, 1]


def test_what_an_installed_law_changes_in_place_is_its_own():
    class Own(VerondaWestmann):
        plugin = "plugin works, law 'veronda_westmann'"

        def isochoric(self, i1, i2, j, parameters):
            found = super().isochoric(i1, i2, j, parameters)
            j *= 2.0
            parameters["C1_MPa"] *= 2.0
            return found

    i1, i2, j = small_strains()
    values = {"C1_MPa": np.array([0.01]), "C2": 6.0, "kappa_MPa": 0.1}
    found = Own().potential(i1, i2, j, values)
    right = VerondaWestmann().potential(*small_strains(), values | {"C1_MPa": 0.01})
    assert np.array_equal(found.energy, right.energy)
    assert np.array_equal(found.d_j, right.d_j)


@pytest.mark.parametrize(
    ("physical", "hook"), [(True, "read"), (True, "when"), (False, "change"), (False, "felt")]
)
def test_an_effect_with_a_hook_that_its_kind_is_never_asked_for_is_refused(physical, hook):
    own = {"physical": physical, "parameters": (SIZE,), hook: lambda self, *given: given[0]}
    own |= dict.fromkeys(("name", "meaning", "formula", "source"), "an_effect")
    with pytest.raises(TypeError, match=f"its physical is {physical}, and it overrides {hook}, wh"):
        check_effect(type("Of", (Effect,), own)())


def test_an_effect_of_a_family_that_is_no_learned_one_is_refused():
    """It would neither be named nor learned: nobody would look for it."""
    own = {"physical": False, "parameters": (SIZE,), "family": "frame"}
    own |= dict.fromkeys(("name", "meaning", "formula", "source"), "an_effect")
    with pytest.raises(TypeError, match="Of has no x_name, y_name, abscissa, function, sentence"):
        check_effect(type("Of", (Effect,), own)())
    nameless = type("Nameless", (type(EFFECTS.get("learned_frame")),), {"family": ""})
    with pytest.raises(TypeError, match="its family is empty"):
        check_effect(nameless())


def test_a_form_of_a_kind_that_there_is_not_is_found():
    """It would stand against no function: the slip would change verdicts."""
    creep = type(EFFECTS.get("viscoelasticity"))
    it_says_what_it_is(creep())
    with pytest.raises(BrokenRuleError, match="form_of is 'tme'; expected one of: frame, history"):
        it_says_what_it_is(type("Of", (creep,), {"form_of": "tme"})())


def test_why_it_is_not_seen_is_a_text():
    own = {"unseen": lambda self, values, longest_s: None}
    with pytest.raises(BrokenRuleError, match="unseen returned None; expected a text"):
        it_says_what_it_is(type("Of", (type(EFFECTS.get("viscoelasticity")),), own)())


FRAME = type(EFFECTS.get("learned_frame"))
SPAN = Parameter("span_mm", "mm", "a length", 0.1, 9.0, None, 1.0, "an example")


@pytest.mark.parametrize(
    ("own", "says"),
    [
        (
            {"parameters": (*FRAME.parameters, SPAN)},
            "span_mbar and span_mm have no zero; expected one such parameter",
        ),
        ({"range_name": "span"}, "its range_name is 'span'; expected the .*, span_mbar"),
        ({"range_name": "", "own_of_each": True}, "its range_name is ''; expected the parameter"),
        ({"range_name": None}, "its range_name is None; expected a text"),
    ],
)
def test_a_learned_effect_has_one_length(own, says):
    """Each parameter without a zero had been set to the length of the range."""
    check_effect(FRAME())
    with pytest.raises(TypeError, match=says):
        check_effect(type("Of", (FRAME,), own)())


PATH = PressurePath((0.0, 1.0), (0.0, 10.0))


@pytest.mark.parametrize(
    ("own", "says"),
    [
        ({"stiffness": np.array([0.9])}, "stiffness is array"),  # the compiled loops crashed
        ({"prony": [Prony(0.1, 1.0)]}, "prony is .*; expected a tuple of Prony"),
        ({"prony": (Prony(0.1, -1.0),)}, "tau_s is -1.0; expected more than 0"),
        ({"below": (Layer(math.nan, 0.1, 0.1),)}, "thickness_mm of a layer is nan; expected a fin"),
        ({"prony": (Prony(-0.1, 1.0),)}, "g is -0.1; expected 0 or more"),
        ({"terms": ("X3",)}, "terms is .*; expected a tuple of Term"),
        ({"terms": (Term("X3", ()),)}, "law of a term is a str; expected an Energy"),
        ({"terms": (Term(CUBIC, (1.0,)),)}, "parameters of a term are .*; expected pairs of a n"),
        ({"terms": (Term(CUBIC, (("X3", 1.0),)),)}, "parameters of a term lack X3_MPa"),
        ({"terms": (Term(CUBIC, (("X3_MPa", None),)),)}, "X3_MPa of a term is None; expected a"),
        ({"geometry": None}, "geometry is a NoneType; expected a Geometry"),
        ({"skin": (0.04, 1.5, 0.32)}, "skin is a tuple; expected a Skin"),
        ({"pressure_mbar": [0.0, 10.0]}, "pressure_mbar of the path is a list; expected a tuple"),
    ],
)
def test_what_an_installed_effect_makes_of_the_skin_is_checked(monkeypatch, own, says):
    class Solid(Effect):
        name = meaning = formula = source = "solid"
        physical = True
        parameters = (SIZE,)

        def change(self, problem, values, cycle):
            return problem if "pressure_mbar" in own else replace(problem, **own)

        def felt(self, path, values):
            return replace(path, **own) if "pressure_mbar" in own else path

    monkeypatch.setitem(EFFECTS._all(), "solid", Solid())
    monkeypatch.setitem(EFFECTS._origins, "solid", plugins.Origin("works", "1.0"))
    given = {"solid": {"size_um": 2.0}}
    with pytest.raises(BrokenPluginError, match=f"plugin works, effect 'solid': broke .*: {says}"):
        solve_skin(
            problem_of(Skin((0.04, 1.5, 0.32)), given, Geometry(6.0, 1.0)), felt_path(given, PATH)
        )


def test_a_law_that_answers_lists_is_named():
    class Listed(VerondaWestmann):
        plugin = "plugin works, law 'veronda_westmann'"

        def isochoric(self, i1, i2, j, parameters):
            found = super().isochoric(i1, i2, j, parameters)
            return replace(found, energy=found.energy.tolist())

    with pytest.raises(BrokenPluginError, match="energy is a list; expected an array of numbers"):
        Listed().potential(*small_strains(), {"C1_MPa": 0.01, "C2": 6.0, "kappa_MPa": 0.1})


@pytest.mark.parametrize(
    ("own", "says"),
    [
        ({"range_of": lambda self, seen: math.nan}, "range_of returned nan"),
        ({"abscissa": lambda self, seen: np.array([])}, r"its abscissa is \[\]"),
        ({"function": lambda self, at, values: at[:3]}, r"its function has the shape \(3,\)"),
        ({"sentence": lambda self, x, y: None}, "its sentence is None"),
    ],
)
def test_what_a_learned_effect_has_besides_is_tried(own, says):
    frame = type(EFFECTS.get("learned_frame"))
    a_learned_one_has_a_function(frame())
    with pytest.raises(BrokenRuleError, match=says):
        a_learned_one_has_a_function(type("Of", (frame,), own)())


def test_what_an_import_changes_for_everybody_is_undone(tmp_path):
    """numpy.seterr(all="raise") in a plugin's module had ended a measurement."""

    class Entry:
        name, dist = "warm_up", None

        def load(self):
            np.seterr(all="raise")
            warnings.simplefilter("error")
            os.chdir(tmp_path)
            return WARM_UP

    before = np.geterr(), list(warnings.filters), os.getcwd()
    own = plugins.Registry("effect", "skinlab.none", "EFFECT", "skinlab.none", check_effect)
    assert own._take(Entry()) is None
    assert (np.geterr(), list(warnings.filters), os.getcwd()) == before
