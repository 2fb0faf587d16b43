"""A reading that comes back on another way than it went, whatever the rate."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from skinlab.mechanics.effects.base import Array, Values
from skinlab.mechanics.effects.learned import LearnedEffect, Seen, coefficients

_SINES = 6
_LINE = f"c{_SINES + 1}"


class LearnedSensorLoop(LearnedEffect):
    """See the module.

    `learned_loop` changes the suction that is felt, and so each opening by what its dome makes of
    it. This changes all domes by the same share of their height.
    """

    name = "learned_sensor_loop"
    family = "history"
    meaning = "a dome reads another height on the way back than on the way up, found from the data"
    formula = (
        "after the highest dome w + top (Σ c_k sin(k π x) + c7 x), x = 1 − w/top, k from 1 to 6"
    )
    source = "hysteresis of skin and of sensors; Gaussian process"
    physical = False
    # Most loops close: sines that are zero at both ends, and a line for those that do not (a Wiener
    # process is a bridge, and where it ends).
    parameters = (
        *coefficients(_SINES, "", 0.5, 0.01),
        replace(coefficients(1, "", 0.5, 0.01)[0], name=_LINE, meaning="of a line"),
    )
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
        x = np.clip(1.0 - at, -1.0, 1.0)
        bridge = sum(values[f"c{k}"] * np.sin(k * np.pi * x) for k in range(1, _SINES + 1))
        return np.asarray(bridge + values[_LINE] * x)

    def sentence(self, x: Array, y: Array) -> str:
        """Say how far the way back is off."""
        i = int(np.abs(y).argmax())
        what = "higher" if y[i] > 0 else "lower"
        return (
            "depends on whether the dome rises or falls, at any rate alike: on the way back it "
            f"stands {what} by {100 * abs(y[i]):.2g} % of its highest, at {100 * x[i]:.0f} % of it"
        )


EFFECT = LearnedSensorLoop()
