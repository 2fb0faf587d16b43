"""Rules of constitutive laws."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields
from typing import Any

import numpy as np

from skinlab.extensions.rules import Kind, expect, first_line, in_a_name
from skinlab.mechanics.materials import LAWS, Law, Potential

_FIRST = ("d_i1", "d_i2", "d_j")
_SECOND = {
    "d_i1": ("d_i1_i1", "d_i1_i2", "d_i1_j"),
    "d_i2": ("d_i1_i2", "d_i2_i2", "d_i2_j"),
    "d_j": ("d_i1_j", "d_i2_j", "d_j_j"),
}
_STEP = 1e-5
_EPS = float(np.finfo(float).eps)


def _parameters(law: Law) -> dict[str, float]:
    """Return the middle of where fits look, as the potential takes it."""
    middle = law.space.from_unit(np.full(len(law.names), 0.5))
    return law.coefficients(law.named(middle.tolist()), "consistent")


def _rest(law: Law) -> Potential:
    three, one = np.array([3.0]), np.array([1.0])
    return law.potential(three, three, one, _parameters(law))


def it_says_what_it_is(law: Law) -> None:
    """It has a source, and each parameter its unit, meaning and source."""
    expect(law.source.strip(), "source is empty")
    names = law.parameter_names  # κ among them
    expect(len(set(names)) == len(names), "two parameters have one name")
    for p in law.parameters:
        expect(p.meaning and p.source, f"{p.name} has no meaning or no source")
        unit = in_a_name(p.unit)
        expect(
            not unit or p.name.endswith(f"_{unit}"), f"{p.name} does not end with its unit, {unit}"
        )


def nothing_at_rest(law: Law) -> None:
    """At rest there is no energy and no stress."""
    p = _rest(law)
    expect(abs(p.energy[0]) < 1e-12, f"its energy at rest is {p.energy[0]:g} MPa")
    # S = 2 ∂W/∂C = (2 W1 + 4 W2 + W_J) 1 there
    stress = float(2 * p.d_i1[0] + 4 * p.d_i2[0] + p.d_j[0])
    expect(abs(stress) < 1e-12, f"2 W1 + 4 W2 + W_J at rest is {stress:g} MPa; expected 0")


def resists_shear(law: Law) -> None:
    """At rest it resists shear."""
    p = _rest(law)
    modulus = float(2 * (p.d_i1[0] + p.d_i2[0]))
    expect(modulus > 0, f"its shear modulus at rest, 2 (W1 + W2), is {modulus:g} MPa")


def resists_a_change_of_volume(law: Law) -> None:
    """At rest it resists a change of volume."""
    modulus = law.bulk_modulus(_parameters(law))
    expect(
        modulus > 0,
        f"its bulk modulus at rest is {modulus:g} MPa; expected more than 0, by Poisson's ratio "
        "(poisson) or in its own energy",
    )


def derivatives_are_the_energys(law: Law) -> None:
    """Its derivatives by I1, I2 and J are those of its energy."""
    rng = np.random.default_rng(0)
    at = [3.2 + rng.uniform(0, 1, 20), 3.3 + rng.uniform(0, 1, 20), rng.uniform(0.5, 1.6, 20)]
    parameters = _parameters(law)
    here = law.potential(at[0], at[1], at[2], parameters)
    for k, first in enumerate(_FIRST):
        up, down = (
            law.potential(moved[0], moved[1], moved[2], parameters)
            for moved in ([x + s * _STEP * (i == k) for i, x in enumerate(at)] for s in (1, -1))
        )
        for of, name in (("energy", first), *((of, c[k]) for of, c in _SECOND.items())):
            slope = (getattr(up, of) - getattr(down, of)) / (2 * _STEP)
            said = np.asarray(getattr(here, name))
            expect(said.shape == (20,), f"{name} has the shape {said.shape}; expected (20,)")
            # A difference of large values is known to their rounding only
            rounding = 8 * _EPS * np.abs(getattr(up, of)) / _STEP
            off = np.abs(said - slope)
            wrong = off > 1e-5 * (1e-3 + np.abs(slope)) + rounding
            worst = off[wrong].max(initial=0.0)
            expect(not wrong.any(), f"{name} is off the slope of {of} by {worst:g}")


def parameters_may_be_arrays(law: Law) -> None:
    """Its parameters may be arrays, one value an element."""
    values: Mapping[str, Any] = {n: np.full((4, 1), v) for n, v in _parameters(law).items()}
    invariants = np.full((4, 3), 3.4), np.full((4, 3), 3.5), np.full((4, 3), 1.1)
    i1, i2, j = invariants
    one = law.potential(i1[0], i2[0], j[0], _parameters(law))
    many = law.potential(i1, i2, j, values)
    for field in fields(Potential):
        pair = getattr(one, field.name), np.broadcast_to(getattr(many, field.name), (4, 3))
        expect(np.allclose(pair[0], pair[1]), f"{field.name} depends on the arrays' shape")


def _row(law: Law) -> tuple[str, ...]:
    return (
        f"`{law.name}`",
        first_line(law),
        ", ".join(f"`{n}`" for n in law.names),
        law.source,
    )


KIND = Kind(
    LAWS,
    (
        it_says_what_it_is,
        nothing_at_rest,
        resists_shear,
        resists_a_change_of_volume,
        derivatives_are_the_energys,
        parameters_may_be_arrays,
    ),
    ("name", "what it is", "parameters", "source"),
    _row,
)
