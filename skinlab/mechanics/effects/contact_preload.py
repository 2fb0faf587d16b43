"""The probe's spring has domed the skin before the suction."""

from __future__ import annotations

from dataclasses import replace

from skinlab.mechanics.effects.base import Effect, Parameter, Values
from skinlab.mechanics.fem.skin import SkinProblem


class ContactPreload(Effect):
    """See the module."""

    name = "contact_preload"
    meaning = "the probe's spring has domed the skin before the suction"
    formula = "w(p + p0) − w(p0); where stress relaxes, it has relaxed at p0"
    source = "Müller et al. 2018: contact force is the main source of scatter"
    physical = True
    needs_history = False
    parameters = (
        Parameter(
            "p0_mbar", "mbar", "the suction that would have domed it as much", 0.0, 100.0, 0.0, 5.0,
            "no published size: a range to look in",
        ),
    )  # fmt: skip

    def change(self, problem: SkinProblem, values: Values, cycle: int) -> SkinProblem:
        """Add to what was there long before."""
        return replace(problem, preload_mbar=problem.preload_mbar + values["p0_mbar"])


EFFECT = ContactPreload()
