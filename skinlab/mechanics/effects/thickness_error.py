"""The skin is thicker or thinner than measured."""

from __future__ import annotations

from dataclasses import replace

from skinlab.mechanics.effects.base import Effect, Parameter, Values
from skinlab.mechanics.fem.skin import SkinProblem
from skinlab.mechanics.fem.suction import Geometry


class ThicknessError(Effect):
    """See the module."""

    name = "thickness_error"
    meaning = "the skin is thicker or thinner than measured"
    formula = "thickness = ratio × the stated one"
    source = "the paper takes 1 mm for all, and skin differs"
    physical = True
    needs_history = False
    parameters = (
        Parameter(
            "ratio", "", "true over stated; 1 is right", 0.4, 2.5, 1.0, 1.1,
            "thickness varies by 0.8–1.6 mm where 1 mm is assumed", "log",
        ),
    )  # fmt: skip

    def change(self, problem: SkinProblem, values: Values, cycle: int) -> SkinProblem:
        """Change the thickness."""
        stated = problem.geometry
        true = Geometry(stated.aperture_mm, values["ratio"] * stated.thickness_mm)
        return replace(problem, geometry=true)


EFFECT = ThicknessError()
