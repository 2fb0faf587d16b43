"""Laws of plugins whose declaration cannot work: refused when they are loaded, and told why."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest
from skinlab_example.fung import Fung

from skinlab.extensions.laws import it_says_what_it_is
from skinlab.extensions.rules import BrokenRuleError
from skinlab.mechanics.materials.base import check_law
from skinlab.parameters import Nodes, Search

C1, C2, NU = Fung.parameters


def law(*parameters, **own):
    return type("Of", (Fung,), {**({"parameters": parameters} if parameters else {}), **own})()


@pytest.mark.parametrize(
    ("one", "says"),
    [
        (law(C1, C2, replace(NU, high=0.7)), "nu, Poisson's ratio, is 0 to 0.7; expected it in 0 "),
        (law(C1, C2, replace(NU, low=-0.5)), "nu, Poisson's ratio, is -0.5 to 0.499; expected "),
        (
            law(replace(C1, search=Search(1e-6, 0.2, "log")), C2, NU),
            "C1_MPa: search is 1e-06 to 0.2; expected what lies within 0.001 to 100",
        ),
        (
            law(C1, C2, replace(NU, axis=Nodes(0.2, 0.6, 4))),
            "nu: axis is 0.2 to 0.6; expected what lies within 0 to 0.499",
        ),
        (law(C1, replace(C2, low=0.0, search=None), NU), "C2 is searched from 0 in its logarithm"),
        (
            law(replace(C1, search=Search(0.02, 0.2, "log", step=-1.0)), C2, NU),
            "C1_MPa: search has the step -1.0; expected more than 0",
        ),
        (
            law(C1, C2, replace(NU, search=Search(0.2, 0.4, reach="far"))),
            "nu: search has the reach 'far'; expected more than 0",
        ),
        (
            law(C1, C2, replace(NU, search=Search(0.2, 0.4, reach=math.nan))),
            "nu: search has the reach nan; expected more than 0",
        ),
        (law(replace(C1, published=5), C2, NU), "C1_MPa: published is 5; expected numbers"),
        (law(C1, replace(C2, published=("a",)), NU), r"published is \('a',\); expected numbers"),
        (law(C1, replace(C2, published=(3.0, 1.0)), NU), "expected rising numbers"),
        (law(derived_names=None), "derived_names are None; expected two: of ν and κ"),
        (law(derived_names=(1, 2)), r"derived_names are \(1, 2\); expected two: of ν and κ"),
    ],
)
def test_what_no_search_can_go_through_is_refused(one, says):
    """They had been taken, and a command broke down later, or answered what cannot be."""
    with pytest.raises((TypeError, ValueError), match=says):
        check_law(one)


def test_a_parameters_name_ends_with_its_unit():
    it_says_what_it_is(Fung())
    with pytest.raises(BrokenRuleError, match="C1_kPa does not end with its unit, MPa"):
        it_says_what_it_is(law(replace(C1, name="C1_kPa"), C2, NU))
