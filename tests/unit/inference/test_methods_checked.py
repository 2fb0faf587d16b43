"""What a method of a plugin declares and answers, where that cannot be: refused, and told why."""

from __future__ import annotations

import math
import sys
from dataclasses import replace

import numpy as np
import pytest

from skinlab import plugins
from skinlab.inference.methods.base import Method, Option, check_method
from skinlab.inference.methods.checked import checked_estimate
from skinlab.inference.problem import Estimate
from skinlab.parameters import Space

SPACE = Space.box(("a", "b"), (0.0, 0.0), (1.0, 1.0))
GOOD = Estimate(np.array([0.5, 0.5]), 1.0, 1, 1, True, np.array([[0.5, 0.5]]))


def method(**own):
    return Method("mine", **{"search": lambda problem, options, rng: GOOD, "meaning": "m", **own})


def option(name="mine", default=1, **own):
    return Option(name, default, **{"help": "h", "expected": "e", **own})


@pytest.mark.parametrize(
    ("own", "says"),
    [
        ({"settle": None}, "its settle is a NoneType; expected a function"),
        ({"remarks": None}, "its remarks is a NoneType; expected a function"),
        ({"remarks": lambda options: "text"}, "its remarks are 'text'; expected a tuple of texts"),
        ({"remarks": lambda options: None}, "its remarks are None; expected a tuple of texts"),
        ({"in_papers_box": "yes"}, "its in_papers_box is 'yes'; expected True or False"),
        ({"options": (option(3),)}, "its option 3 is not a name"),
        ({"options": (option(help=None),)}, "its option mine: help is None; expected a text"),
        ({"options": (option(expected=3),)}, "its option mine: expected is 3; expected a text"),
        ({"options": (option(choices=3),)}, "its option mine: expected a tuple of choices"),
        ({"options": (option(accepts=None),)}, "its option mine: expected a tuple of choices, and"),
        ({"options": (option(), option())}, "two of its options have one name: mine, mine"),
    ],
)
def test_what_a_method_declares_is_looked_at(own, says):
    """Remarks that are one text were printed letter by letter."""
    check_method(method(options=(option(),)))
    with pytest.raises((TypeError, ValueError), match=says):
        check_method(method(**own))


@pytest.mark.parametrize(
    ("own", "says"),
    [
        ({"error_um": -1.0}, "its error_um is -1.0; expected 0 or more"),
        ({"error_um": math.inf}, "its error_um is inf; expected a finite number"),
        ({"iterations": -1}, "its iterations are -1; expected an int, 0 or more"),
        ({"evaluations": 1.0}, "its evaluations are 1.0; expected an int, 0 or more"),
        ({"converged": "no"}, "its converged is 'no'; expected True or False"),
        ({"converged": np.zeros(2)}, "its converged is array"),
        ({"minima": 3}, "its minima have the shape"),
        ({"minima": np.array([0.5, 0.5])}, "its minima have the shape"),
        ({"minima": np.array([[0.5, 1.5]])}, "its minima lie outside of the unit cube"),
    ],
)
def test_an_answer_that_cannot_be_is_none(own, says):
    """A text "no" counted as converged."""
    assert checked_estimate(GOOD, SPACE).converged
    with pytest.raises((TypeError, ValueError), match=says):
        checked_estimate(replace(GOOD, **own), SPACE)


def test_what_a_method_prints_when_it_is_loaded_is_no_part_of_a_document(capsys):
    """It had been a line before the JSON of `skinlab plugins --json`."""

    class Entry:
        name, dist = "mine", None

        def load(self):
            return method(remarks=lambda options: ("",) * sys.stdout.write("here"))

    found = plugins.Registry("method", "skinlab.none", "METHOD", "skinlab.none", check_method)
    assert found._take(Entry()) is None
    said = capsys.readouterr()
    assert (said.out, said.err) == ("", "here")
