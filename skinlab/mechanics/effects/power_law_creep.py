"""Stress relaxes with a power of time: no single relaxation time, but all of them."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np

from skinlab.mechanics.effects.base import Effect, Parameter, Values
from skinlab.mechanics.fem.skin import Prony, SkinProblem

_TIMES_S = (0.1, 1.0, 10.0, 100.0)  # one a decade
_FROM_S = 0.05  # before which nothing relaxes


def shares(amplitude: float, exponent: float) -> tuple[float, ...]:
    """Return the Prony terms' shares; typical creep is followed to 0.03 from 0.02 to 200 s."""
    # What relaxes between the middles of decades is given to the decade's time.
    half = np.sqrt(10.0)
    edges = [0.0, *(t * half for t in _TIMES_S)]
    relaxed = [1.0 / (1.0 + amplitude * ((1.0 + e / _FROM_S) ** exponent - 1.0)) for e in edges]
    return tuple(a - b for a, b in pairwise(relaxed))


class PowerLawCreep(Effect):
    """See the module."""

    name = "power_law_creep"
    meaning = "stress relaxes with a power of time: creep that slows down and does not end"
    formula = (
        "G(t) = 1/(1 + amplitude ((1 + t/0.05 s)^exponent − 1)), as four Prony terms of 0.1, 1, "
        "10 and 100 s"
    )
    source = "Fung 1993, Biomechanics, 7.6: soft tissues relax over decades of time alike"
    physical = True
    form_of = "time"
    parameters = (
        Parameter(
            "amplitude", "", "of the compliance that grows, beside that of 0.05 s", 0.0, 1.5, 0.0,
            0.2, "soft tissue yields by some tenths more in seconds",
        ),
        Parameter(
            "exponent", "", "power of time", 0.03, 0.6, None, 0.2,
            "power-law exponents of soft tissue: 0.02–0.5", "log",
        ),
    )  # fmt: skip

    def change(self, problem: SkinProblem, values: Values, cycle: int) -> SkinProblem:
        """Add the terms."""
        if values["amplitude"] <= 0.0:
            return problem
        each = shares(values["amplitude"], values["exponent"])
        terms = (Prony(g, tau) for g, tau in zip(each, _TIMES_S, strict=True))
        return replace(problem, prony=(*problem.prony, *terms))


EFFECT = PowerLawCreep()
