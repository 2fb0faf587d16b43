"""Stress relaxes: finite-strain Prony series on the isochoric second Piola-Kirchhoff stress."""

from __future__ import annotations

from dataclasses import replace

from skinlab.mechanics.effects.base import Effect, Parameter, Values
from skinlab.mechanics.fem.skin import Prony, SkinProblem

_TIMES = "Abbas et al. 2021: relaxation times of 0.05–8.9 s"


class Viscoelasticity(Effect):
    """See the module."""

    name = "viscoelasticity"
    meaning = "stress relaxes: creep in a hold, hysteresis, dependence on the rate"
    formula = (
        "S = S_vol + (1 − Σg) S_iso + Σ g H, dH/dt + H/τ = dS_iso/dt; "
        "X1, X2 and ν are the instantaneous ones"
    )
    source = "Simo 1987; Holzapfel 2000, 6.10"
    physical = True
    form_of = "time"
    parameters = (
        Parameter("g", "", "share of the stress that relaxes", 0.0, 0.9, 0.0, 0.3, _TIMES),
        Parameter("tau_s", "s", "time in which it does", 0.01, 1000.0, None, 1.0, _TIMES, "log"),
        Parameter("g2", "", "share of a second term", 0.0, 0.9, 0.0, 0.0, _TIMES, default=0.0),
        Parameter(
            "tau2_s", "s", "time of the second term", 0.01, 1000.0, None, 10.0, _TIMES, "log",
            default=10.0,
        ),
    )  # fmt: skip

    def change(self, problem: SkinProblem, values: Values, cycle: int) -> SkinProblem:
        """Add the terms that have a share."""
        terms = (Prony(values["g"], values["tau_s"]), Prony(values["g2"], values["tau2_s"]))
        return replace(problem, prony=(*problem.prony, *(term for term in terms if term.g > 0)))


EFFECT = Viscoelasticity()
