"""A zero of the deflection that drifts with time, in every curve alike, and not evenly."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from skinlab.mechanics.effects.base import Array, Values
from skinlab.mechanics.effects.learned import (
    LearnedEffect,
    Seen,
    line_and_sines,
    nearly_line,
    span,
)

_COEFFICIENTS = 9  # what sets in within 3 of 16 s, by 30 times the noise, needs as many
_BENT = 0.5  # of the line: how much the others are beforehand
_EVEN_S = 1.0  # up to which times count evenly; beyond in the logarithm: what settles does so early
# A kink has sines that fall by k^-2. Alike up to the third, as other functions have them, they cost
# four decades where a zero settles smoothly, which was then called an even drift.
_LINE, *_SINES = nearly_line("µm", 300.0, 10.0, _BENT, _COEFFICIENTS)
_NEARLY_LINE = (
    _LINE,
    *(replace(p, typical=min(1.0, 2.0 / k**1.5) * p.typical) for k, p in enumerate(_SINES, 1)),
)


class LearnedDrift(LearnedEffect):
    """See the module.

    The library's `baseline_drift` is even in time. This one settles, or sets in late: a sensor that
    warms, a holder that gives, tape that creeps under its own load. What each curve does in its own
    way is `learned_wander`.
    """

    name = "learned_drift"
    family = "time"
    meaning = "the zero of the deflection drifts in every curve alike, found from the data"
    formula = "w + c1 t/span + Σ c_k sin((k − 3/2) π x), x = arsinh(t/1 s) / arsinh(span/1 s)"
    source = "drift of distance sensors; Gaussian process"
    physical = False
    order = 3
    range_name = "span_s"
    parameters = (
        *_NEARLY_LINE,
        span("span_s", "s", "time up to which the drift is known", 0.1, 10000.0, 10.0),
    )
    x_name = "time_s"
    y_name = "zero_um"

    def read(self, since_s: Array, deflection_mm: Array, values: Values) -> Array:
        """Add what has drifted since the curve's first sample."""
        return deflection_mm + 1e-3 * self.function(since_s, values)

    def range_of(self, seen: Seen) -> float:
        """Return the time of the longest curve."""
        return seen.time_s

    def abscissa(self, seen: Seen) -> Array:
        """Return times up to the longest curve's end."""
        return np.linspace(0.0, seen.time_s, 41)

    def function(self, at: Array, values: Values) -> Array:
        """Return how far the zero has drifted (m,), µm."""
        span_s = values["span_s"]
        settled = np.arcsinh(at / _EVEN_S) / np.arcsinh(span_s / _EVEN_S)
        return line_and_sines(at / span_s, settled, values, self.names)

    def sentence(self, x: Array, y: Array) -> str:
        """Say how far it drifts."""
        i = int(np.abs(y).argmax())
        return (
            "depends on time, not on suction, and is alike in every curve: the zero of the "
            f"deflection drifts, to {y[i]:+.2g} µm after {x[i]:.2g} s"
        )


EFFECT = LearnedDrift()
