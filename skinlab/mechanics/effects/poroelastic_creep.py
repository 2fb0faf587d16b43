"""Fluid is pressed through the tissue: creep that takes longer under a wider opening."""

from __future__ import annotations

import math
from dataclasses import replace

from skinlab.mechanics.effects.base import Effect, Parameter, Values
from skinlab.mechanics.fem.skin import Prony, SkinProblem

_TERMS = 4  # of the series; what the others would add, 5 % of the amplitude, is in the last
_STATED_MM = 6.0  # the opening that the time is told for


class PoroelasticCreep(Effect):
    """See the module."""

    name = "poroelastic_creep"
    meaning = "fluid flows through the tissue: creep whose time grows with the opening's area"
    formula = (
        "G(t) = 1 − amplitude (1 − 8/π² Σ exp(−n² t/τ)/n²), n = 1, 3, 5, 7, "
        "τ = tau_s (aperture/6 mm)²"
    )
    source = "consolidation: Terzaghi 1943; Biot 1941; tissue: Mow et al. 1980"
    physical = True
    form_of = "time"
    parameters = (
        Parameter(
            "amplitude", "", "share of the stress that the fluid carries at first", 0.0, 0.9, 0.0,
            0.2, "no published size for suction: a range to look in",
        ),
        Parameter(
            "tau_s", "s", "time of the slowest term under 6 mm", 0.05, 1000.0, None, 5.0,
            "(opening's radius)²/(modulus × permeability): seconds to minutes", "log",
        ),
    )  # fmt: skip

    def change(self, problem: SkinProblem, values: Values, cycle: int) -> SkinProblem:
        """Add the terms of the series, slower under a wider opening."""
        amplitude = values["amplitude"]
        if amplitude <= 0.0:
            return problem
        wide = problem.geometry.aperture_mm / _STATED_MM
        tau_s = values["tau_s"] * wide**2
        odd = [2 * k + 1 for k in range(_TERMS)]
        shares = [8.0 / (math.pi * n) ** 2 for n in odd]
        shares[-1] += 1.0 - sum(shares)
        terms = (Prony(amplitude * g, tau_s / n**2) for g, n in zip(shares, odd, strict=True))
        return replace(problem, prony=(*problem.prony, *terms))


EFFECT = PoroelasticCreep()
