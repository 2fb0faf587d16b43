"""What is said of a plugin that breaks down, or makes what cannot be: its name, and the place."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
from skinlab_example.fung import Fung

from skinlab import plugins
from skinlab.curves.pressure_path import PressurePath
from skinlab.curves.program import parse_program
from skinlab.errors import BrokenPluginError, InputError
from skinlab.extensions.laws import nothing_at_rest
from skinlab.extensions.rules import broken
from skinlab.mechanics.effects import EFFECTS
from skinlab.mechanics.effects.base import Effect
from skinlab.mechanics.effects.model import Sensors, felt_path, problem_of
from skinlab.mechanics.fem.skin import Skin
from skinlab.mechanics.fem.suction import Geometry
from skinlab.mechanics.materials.checked import small_strains
from skinlab.parameters import Parameter

SKIN = Skin((0.04, 1.5, 0.32))
PROBE = Geometry(6.0, 1.0)
PATH = PressurePath.of_program(parse_program("ramp:60@40"))
SIZE = Parameter("size_um", "µm", "a size", 0.0, 9.0, 0.0, 1.0, "an example")
GIVEN = {"solid": {"size_um": 2.0}}


class Panic(BaseException):
    """What ends a plugin and is no `Exception`: a panic of compiled code, or `pytest.skip`."""


def panics(*_):
    raise Panic("here")


def installed_effect(monkeypatch, **own):
    """Have an effect as if it were installed; `own` are its hooks."""
    said = {"meaning": "m", "formula": "f", "source": "s", "physical": True, "parameters": (SIZE,)}
    effect = type("Solid", (Effect,), {"name": "solid", **said, **own})()
    monkeypatch.setitem(EFFECTS._all(), "solid", effect)
    monkeypatch.setitem(EFFECTS._origins, "solid", plugins.Origin("works", "1.0"))


def test_a_panic_of_a_plugin_is_named_and_an_interruption_is_none(monkeypatch):
    """It had ended the program with a traceback."""
    installed_effect(monkeypatch, change=panics)
    with pytest.raises(BrokenPluginError, match="works, effect 'solid': broke down: Panic: here"):
        problem_of(SKIN, GIVEN, PROBE)
    assert broken(panics, None).startswith("Panic: here")
    with pytest.raises(KeyboardInterrupt), EFFECTS.at_work("solid"):
        raise KeyboardInterrupt


@pytest.mark.parametrize(
    ("own", "says"),
    [
        (
            {"change": lambda self, problem, values, cycle: replace(problem, stretch=-1.0)},
            "plugin works, effect 'solid': stretch -1: expected a finite number, positive",
        ),
        (
            {"felt": lambda self, path, values: replace(path, pressure_mbar=(), time_s=())},
            "plugin works, effect 'solid': a pressure path needs two knots or more",
        ),
    ],
)
def test_who_makes_a_problem_that_cannot_be_is_named(monkeypatch, own, says):
    installed_effect(monkeypatch, **own)
    with pytest.raises(InputError, match=says):
        (felt_path(GIVEN, PATH), problem_of(SKIN, GIVEN, PROBE))


def test_an_effect_that_is_built_in_names_the_field_of_values_that_cannot_be_together():
    given = {"viscoelasticity": {"g": 0.6, "tau_s": 1.0, "g2": 0.6}}
    with pytest.raises(InputError, match=r"^effects\.viscoelasticity: the shares g of the stress"):
        problem_of(SKIN, given, PROBE)


def test_the_place_of_an_error_is_no_line_of_pythons_own():
    """It had been one of contextlib.py."""

    def rule(_):
        json.loads("{")

    told = broken(rule, None)
    assert told.startswith("JSONDecodeError: ")
    assert "(test_blame.py line " in told
    law = type("Of", (Fung,), {"plugin": "plugin works, law 'of'"})()
    law.isochoric = lambda *given: Fung.isochoric(law, *given).scaled(1j)
    assert (
        broken(nothing_at_rest, law) == "plugin works, law 'of': broke down: TypeError: energy is "
        "an array of complex128; expected an array of numbers"
    )


def refuses(*_):
    raise InputError("no such skin")


def test_a_plugin_that_refuses_is_named():
    law = type("Of", (Fung,), {"plugin": "plugin works, law 'of'", "isochoric": refuses})()
    with pytest.raises(InputError, match=r"^plugin works, law 'of': no such skin$"):
        nothing_at_rest(law)
    with pytest.raises(InputError, match=r"^plugin works, law 'of': no such skin$"):
        law.checked_first(*small_strains(), {})


def test_an_effect_that_refuses_what_it_is_to_read_is_named(monkeypatch):
    installed_effect(monkeypatch, physical=False, read=refuses)
    time_s = np.arange(3.0)
    with pytest.raises(InputError, match=r"^plugin works, effect 'solid': no such skin$"):
        Sensors.of(GIVEN).read(time_s, time_s, time_s, 0.0)
