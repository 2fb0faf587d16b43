"""A reading that comes back on another way than it went, whatever the rate."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from skinlab.mechanics.effects.base import Array, Values
from skinlab.mechanics.effects.learned import LearnedEffect, Seen, coefficients, sines


class LearnedSensorLoop(LearnedEffect):
    """See the module.

    `learned_loop` changes the suction that is felt, and so each opening by what its dome makes of
    it. This changes all domes by the same share of their height.
    """

    name = "learned_sensor_loop"
    family = "history"
    meaning = "a dome reads another height on the way back than on the way up, found from the data"
    formula = "after the highest dome w + top Σ c_k sin((k − ½) π (1 − w/top))"
    source = "hysteresis of skin and of sensors; Gaussian process"
    physical = False
    parameters = tuple(replace(p, name=f"c{k}") for k, p in enumerate(
        coefficients(6, "", 0.5, 0.01), start=1
    ))  # fmt: skip
    x_name = "share_of_dome"
    y_name = "reads_more_of_dome"

    def read(self, since_s: Array, deflection_mm: Array, values: Values) -> Array:
        """Add what the way back reads more."""
        top = float(np.max(deflection_mm, initial=0.0))
        if top <= 0.0:
            return deflection_mm
        back = np.arange(len(deflection_mm)) > int(np.argmax(deflection_mm))
        more = top * self.function(np.maximum(deflection_mm / top, 0.0), values)
        return np.asarray(deflection_mm + np.where(back, more, 0.0))

    def abscissa(self, seen: Seen) -> Array:
        """Return shares of a dome."""
        return np.linspace(0.0, 1.0, 41)

    def function(self, at: Array, values: Values) -> Array:
        """Return how much more is read (m,), in shares of the highest dome, at these shares."""
        return sines(1.0 - at, values, self.names)

    def sentence(self, x: Array, y: Array) -> str:
        """Say how far the way back is off."""
        i = int(np.abs(y).argmax())
        what = "higher" if y[i] > 0 else "lower"
        return (
            "depends on whether the dome rises or falls, at any rate alike: on the way back it "
            f"stands {what} by {100 * abs(y[i]):.2g} % of its highest, at {100 * x[i]:.0f} % of it"
        )


EFFECT = LearnedSensorLoop()
