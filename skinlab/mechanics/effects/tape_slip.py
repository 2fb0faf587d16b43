"""The tape lets the edge give."""

from __future__ import annotations

from dataclasses import replace

from skinlab.mechanics.effects.base import Effect, Parameter, Values
from skinlab.mechanics.fem.skin import SkinProblem


class TapeSlip(Effect):
    """See the module."""

    name = "tape_slip"
    meaning = "the tape lets the edge give"
    formula = "suction on r < R, the skin held only from R + slip on"
    source = "the tape's glue, which the paper's model takes to be rigid"
    physical = True
    needs_history = False
    parameters = (
        Parameter(
            "slip_mm", "mm", "how far from the opening's edge it gives", 0.0, 1.0, 0.0, 0.15,
            "no published size: a range to look in",
        ),
    )  # fmt: skip

    def change(self, problem: SkinProblem, values: Values, cycle: int) -> SkinProblem:
        """Hold the skin from further out."""
        return replace(problem, slip_mm=problem.slip_mm + values["slip_mm"])


EFFECT = TapeSlip()
