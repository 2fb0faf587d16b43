"""Rules of effects."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

from skinlab.curves.pressure_path import PressurePath
from skinlab.curves.program import parse_program
from skinlab.errors import InputError
from skinlab.extensions.rules import Kind, expect, in_a_name
from skinlab.mechanics.effects import EFFECTS, Effect, Parameter, all_effects
from skinlab.mechanics.effects.base import Array, Values
from skinlab.mechanics.effects.history import shows_history
from skinlab.mechanics.effects.learned import LearnedEffect, Seen
from skinlab.mechanics.effects.model import problem_of, response
from skinlab.mechanics.fem.element import QUAD8_FULL
from skinlab.mechanics.fem.skin import Skin, prepare
from skinlab.mechanics.fem.suction import (
    MBAR,
    MESH_OF_RECORD,
    SCREENING_MESH,
    Discretisation,
    Geometry,
)

_SKIN = Skin((0.04, 1.5, 0.32))
_GEOMETRY = Geometry(6.0, 1.0)
_TIMES = np.linspace(0.0, 6.0, 61)
_COARSE = Discretisation("coarse", QUAD8_FULL, 0.05, 2.0, 0.3, 0.5, 0.5, True, (5, 4, 3))
_SEEN_MM = 2e-3  # what a typical size changes at least


def curve(effects: Mapping[str, Values], cycle: int = 2, mesh: Discretisation = _COARSE) -> Array:
    """Return the deflection (61,), mm, of a load, a hold, an unload and a rest.

    Raises:
        BrokenRuleError: the model does not hold up to the highest pressure.
    """
    path = PressurePath.of_program(parse_program("ramp:60@40,hold:2,ramp:0@40,hold:1"))
    found = response(_SKIN, effects, _GEOMETRY, path, _TIMES, cycle=cycle, discretisation=mesh)
    expect(found.stopped == "", f"with {dict(effects)} the model stops: {found.stopped}")
    expect(np.isfinite(found.deflection_mm).all(), f"with {dict(effects)} the curve is not finite")
    return found.deflection_mm


def _apart(a: Array, b: Array) -> float:
    return float(np.sqrt(np.mean((a - b) ** 2)))


def it_says_what_it_is(effect: Effect) -> None:
    """It says what it is, and each parameter its unit, meaning and source."""
    for name in ("meaning", "formula", "source"):
        text = getattr(effect, name)
        expect(text and text.strip() == text, f"{name} is empty, or has blanks around it")
        expect("\n" not in text, f"{name} has more than one line")
    why: object = effect.unseen(effect.typical, 1.0)
    expect(isinstance(why, str), f"unseen returned {why!r}; expected a text, empty: it can be seen")
    kinds = {one.family for one in all_effects()} - {""}
    known = ", ".join(sorted(kinds))
    expect(
        effect.form_of in {"", *kinds}, f"form_of is {effect.form_of!r}; expected one of: {known}"
    )
    size = next((p for p in effect.parameters if p.zero is not None), None)
    expect(size is not None, "no parameter has a zero")
    expect(size and size.typical != size.zero, "the typical size of it is its zero")
    for p in effect.parameters:
        expect(p.meaning and p.source, f"{p.name} has no meaning or no source")
        unit = in_a_name(p.unit)
        named = p.name.endswith(f"_{unit}") if unit else "_" not in p.name
        expect(named, f"{p.name} does not end with its unit, {unit or 'none'}")


def at_its_zero_it_is_not_there(effect: Effect) -> None:
    """At its zero it is the base model, whatever its other parameters are."""
    for cycle in (1, 2):
        off = _apart(curve({effect.name: effect.zero}, cycle), curve({}, cycle))
        expect(off < 1e-12, f"at its zero the curve is off by {off:g} mm")
    for extreme in ("low", "high"):
        others = {p.name: getattr(p, extreme) for p in effect.parameters if p.zero is None}
        off = _apart(curve({effect.name: effect.zero | others}), curve({}))
        expect(off < 1e-12, f"at its zero, with {others}, the curve is off by {off:g} mm")


def more_of_it_does_more(effect: Effect) -> None:
    """A larger size changes the curve more, and a typical one can be seen."""
    base, zero, typical = curve({}), effect.zero, effect.typical
    off = []
    for share in (0.05, 0.5, 1.0):
        values = {n: (1 - share) * zero[n] + share * typical[n] for n in zero}
        off.append(_apart(curve({effect.name: values}), base))
    expect(off[0] < off[1] < off[2], f"a larger size does not change the curve more: {off} mm")
    expect(off[2] > _SEEN_MM, f"a typical size changes the curve by {1e3 * off[2]:.2g} µm only")


def what_it_cannot_be_is_refused(effect: Effect) -> None:
    """Values out of bounds are refused, with the field."""
    good = effect.typical
    wrong = [
        good | {p.name: value}
        for p in effect.parameters
        for value in (p.low - 1, p.high * 1.01 + 1, math.nan, math.inf)
    ]
    for values in [*wrong, good | {"nothing of the kind": 1.0}]:
        try:
            effect.full(values)
        except InputError as error:
            expect(f"effects.{effect.name}." in str(error), f"{error}: does not name the field")
        else:
            expect(False, f"{values} is not refused")


def it_depends_on_the_suction_alone_where_it_says_so(effect: Effect) -> None:
    """Where it says that it needs no history, what it does depends on the suction alone."""
    if not effect.needs_history:
        shown = shows_history(effect)
        expect(not shown, "needs_history is False, and it depends on time, rate, way or cycle")


def the_screening_mesh_sees_it(effect: Effect) -> None:
    """The mesh that effects are screened on sees what it does to within 1 %."""

    def change(mesh: Discretisation) -> Array:
        return curve({effect.name: effect.typical}, mesh=mesh) - curve({}, mesh=mesh)

    exact = change(MESH_OF_RECORD)
    off = _apart(change(SCREENING_MESH), exact) / _apart(exact, np.zeros_like(exact))
    expect(off < 0.01, f"the screening mesh is off by {100 * off:.2g} %")


def the_tangent_is_exact(effect: Effect) -> None:
    """The tangent is the derivative of the forces."""
    off, orders = tangent_error({effect.name: effect.typical})
    expect(abs(orders - 2) < 0.1, f"differences approach the tangent by order {orders:.2f}, not 2")
    expect(off < 1e-3, f"the tangent is off by {100 * off:.2g} %")


def a_learned_one_has_a_function(effect: Effect) -> None:
    """A learned one has a range, a function along it, and a sentence that says what it is."""
    if not isinstance(effect, LearnedEffect):
        return
    left = ((_TIMES, np.sin(_TIMES)),)
    seen = Seen(1.0, 60.0, float(_TIMES[-1]), 2, (4.0, 6.0), left, (0.1 * _TIMES,))
    reach = effect.range_of(seen)
    expect(np.isfinite(reach), f"range_of returned {reach}")
    at = np.asarray(effect.abscissa(seen))
    expect(at.ndim == 1 and len(at) > 1 and np.isfinite(at).all(), f"its abscissa is {at}")
    found = np.asarray(effect.function(at, effect.typical))
    expect(found.shape == at.shape, f"its function has the shape {found.shape}, not {at.shape}")
    expect(np.isfinite(found).all(), "its function is not finite")
    drawn = np.shape(effect.shown(at, found[None]))
    expect(drawn == (1, *at.shape), f"what is shown has the shape {drawn}, not {(1, *at.shape)}")
    said: object = effect.sentence(at, found)
    expect(isinstance(said, str) and said.strip(), f"its sentence is {said!r}")


def tangent_error(effects: Mapping[str, Values]) -> tuple[float, float]:
    """Return by which share the tangent is off central differences, and the order of that."""
    prepared = prepare(problem_of(_SKIN, effects, _GEOMETRY, cycle=2), _COARSE)
    assembly, pressure = prepared.assembly, 100 * MBAR
    rng = np.random.default_rng(3)
    small = 0.02 * np.diff(np.unique(assembly.mesh.nodes[:, 1])).min()  # of the thinnest row
    r, z = assembly.mesh.nodes.T
    deep = z * (1.0 - z / z.min())  # none at the tape, nor where a layer is held from below
    smooth = np.column_stack([0.03 * r * deep, 0.1 * deep]).ravel()
    u = np.zeros(assembly.n)
    u[assembly.equation[assembly.equation < assembly.n]] = smooth[assembly.equation < assembly.n]
    u, v = u + small * rng.normal(size=assembly.n), small * rng.normal(size=assembly.n)
    f = assembly.deformation_gradients(assembly.full(u))
    stress = 0.01 * rng.normal(size=(4, *f.shape[1:]))  # what relaxation may have left
    parameters = prepared.parameters(0.8)

    def forces(at: Array) -> Array:
        state = assembly.evaluate(at, pressure, parameters, stress)
        assert state is not None
        return state.residual

    state = assembly.evaluate(u, pressure, parameters, stress)
    assert state is not None
    band = state.tangent
    exact = band[:, 0] * v
    for k in range(1, band.shape[1]):
        exact[k:] += band[: assembly.n - k, k] * v[: assembly.n - k]
        exact[: assembly.n - k] += band[: assembly.n - k, k] * v[k:]
    if state.skew is not None:
        (e_r, e_z), size = state.skew
        exact -= pressure * size * (e_z * (e_r @ v) - e_r * (e_z @ v))
    steps = np.array([0.2, 0.1, 0.05])
    errors = [
        np.abs((forces(u + h * v) - forces(u - h * v)) / (2 * h) - exact).max() for h in steps
    ]
    order = float(np.polyfit(np.log(steps), np.log(errors), 1)[0])
    return float(errors[-1] / np.abs(exact).max()), order


def _row(effect: Effect) -> tuple[str, ...]:
    acts_on = "the skin" if effect.physical else "the record"
    parameters = "<br>".join(_parameter(p) for p in _told(effect))
    sources = "; ".join(dict.fromkeys([effect.source, *(p.source for p in effect.parameters)]))
    return f"`{effect.name}`", effect.meaning, effect.formula, acts_on, parameters, sources


def _told(effect: Effect) -> list[Parameter]:
    """Return the parameters of a row: of a learned function's coefficients the first."""
    sized = [p for p in effect.parameters if p.zero is not None]
    rest = sized[1:] if effect.family else []
    return [p for p in effect.parameters if p not in rest]


def _parameter(p: Parameter) -> str:
    unit = f" {p.unit}" if p.unit else ""
    zero = "no zero" if p.zero is None else f"zero {p.zero:g}"
    optional = "" if p.default is None else f", {p.default:g} where it is not given"
    return (
        f"`{p.name}` {p.meaning}: {p.low:g} to {p.high:g}{unit}, {zero}, "
        f"typical {p.typical:g}{optional}"
    )


KIND = Kind(
    EFFECTS,
    (
        it_says_what_it_is,
        at_its_zero_it_is_not_there,
        more_of_it_does_more,
        what_it_cannot_be_is_refused,
        it_depends_on_the_suction_alone_where_it_says_so,
        the_screening_mesh_sees_it,
        the_tangent_is_exact,
        a_learned_one_has_a_function,
    ),
    (
        "name",
        "what it is",
        "definition",
        "acts on",
        "parameters: bounds, zero, typical",
        "source",
    ),
    _row,
)
