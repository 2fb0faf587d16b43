"""Rules of inverse methods."""

from __future__ import annotations

import math
from functools import cache

import numpy as np

from skinlab.curves.curve import Curve, Setup
from skinlab.curves.program import parse_program
from skinlab.extensions.rules import Kind, expect
from skinlab.inference.identify import Identifier
from skinlab.inference.methods import METHODS, Method
from skinlab.inference.problem import Options
from skinlab.inference.result import Identification
from skinlab.mechanics.fem.suction import Geometry
from skinlab.tables.store import shipped_grid

_TRUE = (0.03, 1.0, 0.32)  # of the paper's blind test
_NEAR_UM = 5.0  # E


@cache
def _curve() -> Curve:
    """Return the curve of a known skin, 51 samples with a noise of 1 µm."""
    program = parse_program("ramp:100@20")
    time_s = np.linspace(0.0, 5.0, 51)
    pressure_mbar = np.linspace(0.0, 100.0, 51)
    model = shipped_grid().model(Geometry(6.0, 1.0), pressure_mbar)
    noise = np.random.default_rng(0).normal(0.0, 1e-3, 51)
    deflection_mm = model.deflection_mm(np.array([_TRUE]))[0] + noise
    setup = Setup(6.0, 1.0, program)
    return Curve("curve", setup, time_s, pressure_mbar, deflection_mm, program.segment_at(time_s))


@cache
def _found(method: str) -> Identification:
    return Identifier(shipped_grid(), method=method, options=Options())(_curve())


def it_says_what_it_is(method: Method) -> None:
    """It says how it finds the answer, and each option what it does."""
    expect(method.meaning.strip(), "meaning is empty")
    expect(not method.meaning.endswith("."), "meaning ends with a full stop")
    names = [option.name for option in method.options]
    expect(len(set(names)) == len(names), "two options have one name")
    for option in method.options:
        expect(option.help.strip(), f"option {option.name} has no help")
        expect(option.expected or option.choices, f"option {option.name} says nowhere what can be")
        option.checked(option.default)
        expect(option.parse(str(option.default)) == option.default, f"{option.name} cannot be said")


def it_explains_a_curve_of_the_model(method: Method) -> None:
    """It explains a curve of the model."""
    found = _found(method.name)
    expect(found.error is None, f"it has no answer: {found.error}")
    expect(found.error_um is not None and math.isfinite(found.error_um), "its E is not finite")
    assert found.error_um is not None
    expect(found.error_um < _NEAR_UM, f"its E is {found.error_um:.3g} µm; expected < {_NEAR_UM:g}")
    values = [v.value for v in (found.parameters or {}).values()]
    expect(values and np.isfinite(values).all(), "its parameters are not finite")


def what_it_says_of_its_answer_holds(method: Method) -> None:
    """Its E is that of the parameters that it answers."""
    found = _found(method.name)
    expect(found.model_mm is not None, "there is no fitted curve")
    assert found.model_mm is not None
    assert found.error_um is not None
    off = found.model_mm - _curve().deflection_mm
    error_um = 1e3 * float(np.sqrt(np.nansum(off**2))) / found.fitted_points
    expect(
        math.isclose(error_um, found.error_um, rel_tol=1e-6, abs_tol=1e-9),
        f"its error is {found.error_um:g} µm, and its parameters give {error_um:g}",
    )
    expect(found.evaluations > 0, "it counts no evaluations")


def the_same_seed_gives_the_same_bits(method: Method) -> None:
    """The same seed gives the same bits."""
    first = _found(method.name)
    again = Identifier(shipped_grid(), method=method.name)(_curve())
    same = (first.parameters, first.evaluations) == (again.parameters, again.evaluations)
    expect(same, "a second run gives another answer")


def a_curve_without_an_answer_is_no_crash(method: Method) -> None:
    """A curve that no skin explains is no crash."""
    given = _curve()
    time_s, pressure_mbar, deflection_mm = (
        each[::5] for each in (given.time_s, given.pressure_mbar, given.deflection_mm)
    )
    for wrong_mm in (np.zeros(len(time_s)), -deflection_mm):
        flat = Curve("curve", given.setup, time_s, pressure_mbar, wrong_mm)
        Identifier(shipped_grid(), method=method.name)(flat)


def _row(method: Method) -> tuple[str, ...]:
    options = "<br>".join(
        f"`{o.flag}` {o.help}: {o.expected or ' or '.join(map(str, o.choices))} [{o.default}]"
        for o in method.options
    )
    where = "the paper's box" if method.in_papers_box else "the whole range of the database"
    return f"`{method.name}`", method.meaning, where, options


KIND = Kind(
    METHODS,
    (
        it_says_what_it_is,
        it_explains_a_curve_of_the_model,
        what_it_says_of_its_answer_holds,
        the_same_seed_gives_the_same_bits,
        a_curve_without_an_answer_is_no_crash,
    ),
    ("name", "how it finds the answer", "searches", "options of its own"),
    _row,
)
