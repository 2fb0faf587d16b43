"""The skin is stretched in its plane before the tape is put on."""

from __future__ import annotations

from dataclasses import replace

from skinlab.mechanics.effects.base import Effect, Parameter, Values
from skinlab.mechanics.fem.skin import SkinProblem


class NaturalTension(Effect):
    """See the module."""

    name = "natural_tension"
    meaning = "the skin is stretched in its plane before the tape is put on"
    formula = (
        "W(F F0)/det F0, F0 = diag(stretch, λz, stretch), λz free of stress through the thickness"
    )
    source = "Diridollou et al. 2000"
    physical = True
    needs_history = False
    parameters = (
        Parameter(
            "stretch", "", "in the plane; 1 is none", 1.0, 1.2, 1.0, 1.03,
            "tension of 13.5 ± 5 kPa (forearm, Diridollou 2000), 28–92 kPa (arm, Auckland)",
        ),
    )  # fmt: skip

    def change(self, problem: SkinProblem, values: Values, cycle: int) -> SkinProblem:
        """Stretch the skin; aperture and thickness are those of the stretched skin."""
        return replace(problem, stretch=problem.stretch * values["stretch"])


EFFECT = NaturalTension()
