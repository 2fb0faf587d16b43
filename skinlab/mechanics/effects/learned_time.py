"""A relaxation that nobody knows: shares of the stress that relax in decades of time."""

from __future__ import annotations

from dataclasses import replace
from typing import ClassVar

import numpy as np

from skinlab.mechanics.effects.base import Array, Parameter, Values
from skinlab.mechanics.effects.learned import LearnedEffect, Seen
from skinlab.mechanics.fem.skin import Prony, SkinProblem

_TIMES_S = (0.1, 0.5, 2.5, 12.5, 62.5)
_SEEN = 0.1  # of the largest share: what is smaller is not told
_LATE = 2.0  # lengths of the curves: what relaxes later looks like what does not
_EDGE = 5.0**0.5  # of a term's stretch of time, to either side


class LearnedTime(LearnedEffect):
    """See the module."""

    name = "learned_time"
    family = "time"
    meaning = "stress relaxes by a spectrum of times, found from the data"
    formula = "S_vol + (1 − Σg) S_iso + Σ g H, dH/dt + H/τ = dS_iso/dt, τ of 0.1 to 62.5 s"
    source = "relaxation spectra of soft tissue: Fung 1993, Biomechanics, 7.6"
    physical = True
    parameters = tuple(
        Parameter(
            f"g{k}", "", f"share of the stress that relaxes in {tau:g} s", 0.0, 0.6, 0.0, 0.05,
            "shares of all terms together are below 1",
        )
        for k, tau in enumerate(_TIMES_S, start=1)
    )  # fmt: skip
    times_s: ClassVar[tuple[float, ...]] = _TIMES_S
    x_name = "time_s"
    y_name = "share_that_relaxes"

    def change(self, problem: SkinProblem, values: Values, cycle: int) -> SkinProblem:
        """Add the terms that have a share."""
        terms = zip((values[n] for n in self.names), self.times_s, strict=True)
        return replace(
            problem, prony=(*problem.prony, *(Prony(g, tau) for g, tau in terms if g > 0))
        )

    def abscissa(self, seen: Seen) -> Array:
        """Return the relaxation times that curves of this length can show."""
        return np.array([t for t in self.times_s if t <= _LATE * seen.time_s] or self.times_s[:1])

    def function(self, at: Array, values: Values) -> Array:
        """Return the share (m,) that relaxes in each of the times."""
        return np.interp(at, self.times_s, [values[n] for n in self.names])

    def sentence(self, x: Array, y: Array) -> str:
        """Say over which times it creeps."""
        return f"{self._times(x, y)}, in which {100 * y.sum():.0f} % of the stress relaxes"

    @staticmethod
    def _times(x: Array, y: Array) -> str:
        seen = x[y >= _SEEN * y.max()]
        low, high = seen.min() / _EDGE, seen.max() * _EDGE
        return f"depends on time, not on suction: a creep from {low:.1g} to {high:.2g} s"


EFFECT = LearnedTime()
