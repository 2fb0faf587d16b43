"""A pressure channel that moves with time: its zero is another one at the end than at the start."""

from __future__ import annotations

import numpy as np

from skinlab.curves.pressure_path import PressurePath
from skinlab.mechanics.effects.base import Array, Values
from skinlab.mechanics.effects.learned import (
    LearnedEffect,
    Seen,
    drifted,
    line_and_sines,
    nearly_line,
    span,
)

_BENT = 0.3  # of the line: how much the others are beforehand; a drift is nearly even


class LearnedPressureDrift(LearnedEffect):
    """See the module.

    What is felt differs from what is read by what time since the curve's beginning makes of it, in
    every curve alike: the channel warms, or its zero was taken amid a change.
    """

    name = "learned_pressure_drift"
    family = "pressure_drift"
    meaning = "the zero of the pressure channel drifts in each curve, found from the data"
    formula = "p + c1 t/span + Σ c_k sin((k − 3/2) π t/span), k from 2 on"
    source = "drift of pressure sensors; Gaussian process"
    physical = True
    order = 1
    range_name = "span_s"
    parameters = (
        *nearly_line("mbar", 50.0, 1.0, _BENT),
        span("span_s", "s", "time up to which the drift is known", 0.1, 10000.0, 10.0),
    )
    x_name = "time_s"
    y_name = "felt_more_mbar"

    def felt(self, path: PressurePath, values: Values) -> PressurePath:
        """Let what is felt drift."""
        if not any(values[n] for n in self.names):
            return path
        return drifted(path, lambda t: self.function(t, values))

    def range_of(self, seen: Seen) -> float:
        """Return a little more than the longest curve."""
        return 1.25 * seen.time_s

    def abscissa(self, seen: Seen) -> Array:
        """Return times up to the longest curve's end."""
        return np.linspace(0.0, seen.time_s, 41)

    def function(self, at: Array, values: Values) -> Array:
        """Return how much more suction is felt (m,), mbar, than is read."""
        share = at / values["span_s"]
        return line_and_sines(share, share, values, self.names)

    def sentence(self, x: Array, y: Array) -> str:
        """Say how far the channel drifts."""
        i = int(np.abs(y).argmax())
        what = "more" if y[i] > 0 else "less"
        return (
            "drifts with time in the pressure channel, in every curve alike: the skin feels "
            f"{abs(y[i]):.2g} mbar {what} than is read after {x[i]:.3g} s"
        )


EFFECT = LearnedPressureDrift()
