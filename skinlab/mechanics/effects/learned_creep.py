"""A dome that creeps: a share of every rise comes later, by a spectrum of times."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from skinlab.mechanics.effects.base import Array, Effect, Values
from skinlab.mechanics.effects.learned_time import LearnedTime

_TIMES_S = (0.5, 2.5, 12.5, 62.5)


class LearnedCreep(LearnedTime):
    """See the module.

    `learned_time` lets the stress relax in every point of the skin, which moves a curve along the
    suction. This moves it along the deflection: as the viscoelastic share of a dome is read off a
    curve (Uv/Ue), whatever its height. What comes within a tenth of a second is a gain of the
    sensor, and is not learned here.
    """

    name = "learned_creep"
    meaning = "a share of every rise of the dome comes later, by a spectrum of times from the data"
    formula = "w + Σ c_k ∫ (1 − exp(−(t − s)/τ_k)) dw(s), τ of 0.5 to 62.5 s"
    source = "quasi-linear viscoelasticity of a whole structure: Fung 1993, Biomechanics, 7.6"
    physical = False
    parameters = tuple(
        replace(p, name=f"c{k}", meaning=f"share of a rise that comes in {tau:g} s", high=2.0)
        for k, (p, tau) in enumerate(
            zip(LearnedTime.parameters[1:], _TIMES_S, strict=True), start=1
        )
    )
    times_s = _TIMES_S
    y_name = "share_that_comes_later"
    change = Effect.change

    def read(self, since_s: Array, deflection_mm: Array, values: Values) -> Array:
        """Add what comes later; as if the skin had been at rest before the first sample."""
        found = deflection_mm
        for name, tau in zip(self.names, self.times_s, strict=True):
            if values[name]:
                found = found + values[name] * _late(since_s, deflection_mm, tau)
        return found

    def sentence(self, x: Array, y: Array) -> str:
        """Say over which times it creeps."""
        return f"{self._times(x, y)}, by {100 * y.sum():.0f} % of each rise of the dome"


def _late(time_s: Array, deflection_mm: Array, tau_s: float) -> Array:
    """Return ∫ (1 − exp(−(t − s)/τ)) dw(s) (n,): a first-order filter of w, which begins at zero.

    Exact where w is a straight line between samples.
    """
    from scipy.linalg import solve_banded  # slow to import

    w = deflection_mm - deflection_mm[:1]
    if len(w) < 2:
        return w
    step = np.maximum(np.diff(time_s) / tau_s, 1e-9)
    keep, mean = np.exp(-step), -np.expm1(-step) / step
    driven = np.concatenate([w[:1], (1.0 - mean) * w[1:] + (mean - keep) * w[:-1]])
    band = np.vstack([np.ones(len(w)), np.append(-keep, 0.0)])
    return np.asarray(solve_banded((1, 0), band, driven, check_finite=False))


EFFECT = LearnedCreep()
