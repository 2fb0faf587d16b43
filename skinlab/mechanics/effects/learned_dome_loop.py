"""A dome that comes back on another way than it went, by the share of the suction."""

from __future__ import annotations

import numpy as np

from skinlab.mechanics.effects.base import Array, Values
from skinlab.mechanics.effects.learned_sensor_loop import LearnedSensorLoop


class LearnedDomeLoop(LearnedSensorLoop):
    """See the module.

    Openings dome differently: what is a smooth function of the share of the suction under all of
    them is none of the share of their domes.
    """

    name = "learned_dome_loop"
    meaning = "a dome is higher or lower on the way back than on the way up, found from the data"
    formula = (
        "after the highest suction w + top (Σ c_k sin(k π x) + c7 x), x = 1 − p/p_top, "
        "k from 1 to 6, top the highest dome"
    )
    x_name = "share_of_suction"

    def read(self, since_s: Array, deflection_mm: Array, values: Values) -> Array:
        """Leave it: without a suction there is no share of it."""
        return deflection_mm

    def read_along(
        self, since_s: Array, pressure_mbar: Array, deflection_mm: Array, values: Values
    ) -> Array:
        """Add what the way back reads more."""
        highest = float(np.max(pressure_mbar, initial=0.0))
        if highest <= 0.0:
            return deflection_mm
        top = float(np.max(deflection_mm, initial=0.0))
        back = np.arange(len(pressure_mbar)) > int(np.argmax(pressure_mbar))
        more = top * self.function(np.maximum(pressure_mbar / highest, 0.0), values)
        return np.asarray(deflection_mm + np.where(back, more, 0.0))

    def sentence(self, x: Array, y: Array) -> str:
        """Say how far the way back is off."""
        i = int(np.abs(y).argmax())
        what = "higher" if y[i] > 0 else "lower"
        return (
            "depends on whether the suction rises or falls, at any rate alike: on the way back the "
            f"dome stands {what} by {100 * abs(y[i]):.2g} % of its highest, at {100 * x[i]:.0f} % "
            "of the suction"
        )


EFFECT = LearnedDomeLoop()
