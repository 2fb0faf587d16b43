"""A curve of the deflection sensor in shares of each dome: its range is set for each curve."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from skinlab.mechanics.effects.base import Array, Values
from skinlab.mechanics.effects.learned import LearnedEffect, Seen, coefficients, less_gain, sines


class LearnedSensorRange(LearnedEffect):
    """See the module.

    `learned_sensor_curve` is one curve by the height. A sensor whose range goes with the dome (a
    head for each opening, a range that is set anew) bends each curve at the same share of it.
    """

    name = "learned_sensor_range"
    family = "sensor_curve"
    meaning = "the deflection sensor bends each curve at the same share of it, found from the data"
    formula = "w + top Σ c_k sin((k − ½) π w/top), top the highest dome of the curve"
    source = "characteristic curves and clipping of sensors with ranges; Gaussian process"
    physical = False
    needs_history = False
    parameters = tuple(replace(p, name=f"c{k}") for k, p in enumerate(
        coefficients(6, "", 0.5, 0.01), start=1
    ))  # fmt: skip
    x_name = "share_of_dome"
    y_name = "reads_too_much_of_dome"

    def read(self, since_s: Array, deflection_mm: Array, values: Values) -> Array:
        """Add what the sensor reads too much."""
        top = float(np.max(deflection_mm, initial=0.0))
        if top <= 0.0:
            return deflection_mm
        return deflection_mm + top * self.function(deflection_mm / top, values)

    def abscissa(self, seen: Seen) -> Array:
        """Return shares of a dome."""
        return np.linspace(0.0, 1.0, 41)

    def function(self, at: Array, values: Values) -> Array:
        """Return what is read too much (m,), in shares of the highest dome, at these shares."""
        return sines(at, values, self.names)

    def shown(self, x: Array, y: Array) -> Array:
        """Leave a gain out."""
        return less_gain(x, y)

    def sentence(self, x: Array, y: Array) -> str:
        """Say where it reads wrong, and by how much."""
        i = int(np.abs(y).argmax())
        what = "much" if y[i] > 0 else "little"
        return (
            "depends on the share of each curve's highest dome, not on suction or time: the "
            f"deflection sensor is not linear and reads {100 * abs(y[i]):.2g} % of that dome too "
            f"{what} at {100 * x[i]:.0f} % of it, whatever its gain"
        )


EFFECT = LearnedSensorRange()
