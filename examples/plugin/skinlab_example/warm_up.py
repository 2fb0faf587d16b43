"""The deflection channel creeps while the sensor warms up."""

from __future__ import annotations

import numpy as np

from skinlab.mechanics.effects.base import Array, Effect, Parameter, Values


class WarmUp(Effect):
    """See the module."""

    name = "warm_up"
    meaning = "the deflection channel creeps while the sensor warms up"
    formula = "w + rise (1 − exp(−(t − t of the first sample)/τ))"
    source = "an example: no published size"
    physical = False  # it changes the record, not the skin
    order = 2  # after a gain and an offset of the channel
    parameters = (
        Parameter(
            "rise_um", "µm", "where the creep ends", -200.0, 200.0, 0.0, 20.0,
            "an example: a range to look in",
        ),
        Parameter(
            "tau_s", "s", "time in which it does", 0.1, 100.0, None, 1.0,
            "an example: a range to look in", "log",
        ),
    )  # fmt: skip

    def read(self, since_s: Array, deflection_mm: Array, values: Values) -> Array:
        """Add the creep."""
        warm = 1.0 - np.exp(-since_s / values["tau_s"])
        return deflection_mm + 1e-3 * values["rise_um"] * warm


EFFECT = WarmUp()
