"""A soft layer under the dermis that pulls back."""

from __future__ import annotations

from dataclasses import replace

from skinlab.mechanics.effects.base import Effect, Parameter, Values
from skinlab.mechanics.fem.skin import Layer, SkinProblem
from skinlab.mechanics.materials.compressibility import kappa_ratio

NU = 0.45  # fat is nearly incompressible


class Hypodermis(Effect):
    """See the module."""

    name = "hypodermis"
    meaning = "a soft layer under the dermis pulls back"
    formula = "bonded neo-Hookean layer (X2 = 0, ν = 0.45), its base held"
    source = "suction and indentation studies that put a layer of fat under the dermis"
    physical = True
    needs_history = False
    curved = True
    parameters = (
        Parameter(
            "thickness_mm", "mm", "of the layer", 0.1, 30.0, None, 4.0,
            "ultrasound: some mm to some cm", "log",
        ),
        Parameter(
            "X1_kPa", "kPa", "its stiffness", 0.0, 100.0, 0.0, 1.0,
            "published C10 of 0.04–4 kPa",
        ),
    )  # fmt: skip

    def change(self, problem: SkinProblem, values: Values, cycle: int) -> SkinProblem:
        """Put it under all that is there; it is not stretched with the skin."""
        if values["X1_kPa"] == 0.0:
            return problem
        x1 = 1e-3 * values["X1_kPa"]
        layer = Layer(values["thickness_mm"], x1, x1 * float(kappa_ratio(NU, problem.skin.kappa)))
        return replace(problem, below=(*problem.below, layer))


EFFECT = Hypodermis()
