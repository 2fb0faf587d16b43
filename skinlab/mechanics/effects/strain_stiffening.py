"""The skin stiffens more at large stretch than the law can say."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from types import MappingProxyType
from typing import Any

from skinlab.mechanics.effects.base import Effect, Parameter, Values
from skinlab.mechanics.fem.skin import SkinProblem, Term
from skinlab.mechanics.materials.base import Array, Energy, Potential, potential_of_j1


class Cubic(Energy):
    """W = X3 (J1 − 3)³, the third term of Yeoh's law."""

    name = "cubic"
    linear = True
    multiplies = MappingProxyType({"X3_MPa": "(J1 − 3)³"})
    parameter_names = ("X3_MPa",)
    source = "Yeoh 1993"

    def isochoric(self, i1: Array, i2: Array, j: Array, parameters: Mapping[str, Any]) -> Potential:
        """Return energy and derivatives; X3_MPa in MPa."""
        x3 = parameters["X3_MPa"]
        return potential_of_j1(i1, j, lambda e: (x3 * e**3, 3.0 * x3 * e * e, 6.0 * x3 * e))


CUBIC = Cubic()


class StrainStiffening(Effect):
    """See the module."""

    name = "strain_stiffening"
    meaning = "the skin stiffens more at large stretch than the law can say"
    formula = "W + X3 (J1 − 3)³"
    source = "the third power of Yeoh 1993"
    physical = True
    form_of = "law"
    needs_history = False
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
