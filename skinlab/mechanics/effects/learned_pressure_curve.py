"""A curve of the pressure that nobody knows: the skin feels another suction than is read."""

from __future__ import annotations

import numpy as np

from skinlab.curves.pressure_path import PressurePath
from skinlab.mechanics.effects.base import Array, Values
from skinlab.mechanics.effects.learned import (
    LearnedEffect,
    Seen,
    bent,
    coefficients,
    less_gain,
    sines,
    span,
    suction_share,
)


class LearnedPressureCurve(LearnedEffect):
    """See the module."""

    name = "learned_pressure_curve"
    family = "pressure_curve"
    meaning = "the pressure channel has a characteristic of its own, found from the data"
    formula = "p + Σ c_k sin((k − ½) π x), x = arsinh(p/20 mbar) / arsinh(span/20 mbar)"
    source = "characteristic curves of pressure sensors; Gaussian process"
    physical = True
    needs_history = False
    bends = True
    order = 1
    range_name = "span_mbar"
    parameters = (
        *coefficients(6, "mbar", 50.0, 2.0),
        span("span_mbar", "mbar", "suction up to which the curve is known", 10.0, 1000.0, 400.0),
    )
    x_name = "pressure_mbar"
    y_name = "felt_more_mbar"

    def felt(self, path: PressurePath, values: Values) -> PressurePath:
        """Bend the path."""
        if not any(values[n] for n in self.names):
            return path
        return bent(path, lambda p: self.function(p, values))

    def range_of(self, seen: Seen) -> float:
        """Return a little more than the highest suction."""
        return 1.25 * seen.pressure_mbar

    def abscissa(self, seen: Seen) -> Array:
        """Return suctions up to the highest one."""
        return np.linspace(0.0, seen.pressure_mbar, 41)

    def function(self, at: Array, values: Values) -> Array:
        """Return how much more suction is felt (m,), mbar, than is read."""
        return sines(suction_share(at, values["span_mbar"]), values, self.names)

    def shown(self, x: Array, y: Array) -> Array:
        """Leave a gain out."""
        return less_gain(x, y)

    def sentence(self, x: Array, y: Array) -> str:
        """Say where the channel is off, and by how much."""
        i = int(np.abs(y).argmax())
        what = "more" if y[i] > 0 else "less"
        return (
            "depends on the suction alone, alike at every opening and rate: the skin feels "
            f"{abs(y[i]):.2g} mbar {what} than is read at {x[i]:.0f} mbar, "
            "whatever the channel's gain"
        )


EFFECT = LearnedPressureCurve()
