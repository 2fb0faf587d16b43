"""A curve of the deflection sensor that nobody knows."""

from __future__ import annotations

import numpy as np

from skinlab.mechanics.effects.base import Array, Values
from skinlab.mechanics.effects.learned import (
    LearnedEffect,
    Seen,
    coefficients,
    less_gain,
    sines,
    span,
)


class LearnedSensorCurve(LearnedEffect):
    """See the module."""

    name = "learned_sensor_curve"
    family = "sensor_curve"
    meaning = "the deflection sensor has a characteristic of its own, found from the data"
    formula = "w + Σ c_k sin((k − ½) π w/span)"
    source = "characteristic curves of optical distance sensors; Gaussian process"
    physical = False
    needs_history = False
    range_name = "span_mm"
    parameters = (
        *coefficients(6, "µm", 300.0, 10.0),
        span("span_mm", "mm", "height up to which the curve is known", 0.05, 20.0, 2.0),
    )
    x_name = "deflection_mm"
    y_name = "reads_too_much_um"

    def read(self, since_s: Array, deflection_mm: Array, values: Values) -> Array:
        """Add what the sensor reads too much."""
        return deflection_mm + 1e-3 * self.function(deflection_mm, values)

    def range_of(self, seen: Seen) -> float:
        """Return a little more than the highest dome."""
        return 1.25 * seen.height_mm

    def abscissa(self, seen: Seen) -> Array:
        """Return heights up to the highest dome."""
        return np.linspace(0.0, seen.height_mm, 41)

    def function(self, at: Array, values: Values) -> Array:
        """Return what is read too much (m,), µm, at these heights."""
        return sines(at / values["span_mm"], values, self.names)

    def shown(self, x: Array, y: Array) -> Array:
        """Leave a gain out."""
        return less_gain(x, y)

    def sentence(self, x: Array, y: Array) -> str:
        """Say where it reads wrong, and by how much."""
        i = int(np.abs(y).argmax())
        what = "much" if y[i] > 0 else "little"
        return (
            "depends on the height of the dome alone, not on suction or time: the deflection "
            f"sensor is not linear and reads {abs(y[i]):.0f} µm too {what} at {x[i]:.2g} mm, "
            "whatever its gain"
        )


EFFECT = LearnedSensorCurve()
