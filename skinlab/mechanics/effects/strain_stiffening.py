"""The skin stiffens more at large stretch than the law can say."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from skinlab.mechanics.effects.base import Effect, Parameter, Values
from skinlab.mechanics.fem.skin import SkinProblem, Term
from skinlab.mechanics.materials.base import Array, Energy, Potential


class Cubic(Energy):
    """W = X3 (J1 − 3)³, the third term of Yeoh's law."""

    name = "cubic"
    linear = True
    parameter_names = ("X3_MPa",)
    source = "Yeoh 1993"

    def isochoric(self, i1: Array, i2: Array, j: Array, parameters: Mapping[str, Any]) -> Potential:
        """Return energy and derivatives; X3_MPa in MPa."""
        x3 = parameters["X3_MPa"]
        a = j ** (-2.0 / 3.0)  # J1 = a I1
        a_j = -2.0 / 3.0 * a / j
        e = a * i1 - 3.0
        first, second = 3.0 * x3 * e * e, 6.0 * x3 * e  # by J1
        j1_j = a_j * i1
        j1_jj = -5.0 / 3.0 * j1_j / j
        nothing = 0.0 * i1
        return Potential(
            energy=x3 * e**3,
            d_i1=first * a,
            d_i2=nothing,
            d_j=first * j1_j,
            d_i1_i1=second * a * a,
            d_i1_i2=nothing,
            d_i2_i2=nothing,
            d_i1_j=second * a * j1_j + first * a_j,
            d_i2_j=nothing,
            d_j_j=second * j1_j * j1_j + first * j1_jj,
        )


CUBIC = Cubic()


class StrainStiffening(Effect):
    """See the module."""

    name = "strain_stiffening"
    meaning = "the skin stiffens more at large stretch than the law can say"
    formula = "W + X3 (J1 − 3)³"
    source = "the third power of Yeoh 1993"
    physical = True
    parameters = (
        Parameter(
            "X3_MPa", "MPa", "of the third power", 0.0, 5000.0, 0.0, 100.0,
            "50–300 MPa change the dome at 100 mbar by 5–15 %",
        ),
    )  # fmt: skip

    def change(self, problem: SkinProblem, values: Values, cycle: int) -> SkinProblem:
        """Add the energy to the skin's own."""
        if values["X3_MPa"] == 0.0:
            return problem
        term = Term(CUBIC, (("X3_MPa", values["X3_MPa"]),))
        return replace(problem, terms=(*problem.terms, term))


EFFECT = StrainStiffening()
