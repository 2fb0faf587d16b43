"""Later loadings of a site are softer than its first."""

from __future__ import annotations

from dataclasses import replace

from skinlab.mechanics.effects.base import Effect, Parameter, Values
from skinlab.mechanics.fem.skin import SkinProblem


class Preconditioning(Effect):
    """See the module."""

    name = "preconditioning"
    meaning = "later loadings of a site are softer than its first"
    formula = "W × (1 − softening) from cycle 2 on"
    source = "Abbas et al. 2021: the first cycle differs from cycles 2–4"
    physical = True
    form_of = "history"
    parameters = (
        Parameter(
            "softening", "", "share of the stiffness that is gone then", 0.0, 0.9, 0.0, 0.1,
            "no published size for this law: a range to look in",
        ),
    )  # fmt: skip

    def change(self, problem: SkinProblem, values: Values, cycle: int) -> SkinProblem:
        """Soften the skin from the second cycle on."""
        if cycle == 1:
            return problem
        return replace(problem, stiffness=problem.stiffness * (1.0 - values["softening"]))


EFFECT = Preconditioning()
