"""A deflection sensor whose slope changes at a share of each dome: of a range set for each."""

from __future__ import annotations

import numpy as np

from skinlab.mechanics.effects.base import Array, Values
from skinlab.mechanics.effects.learned_sensor_knee import corner, pieces, slopes
from skinlab.mechanics.effects.learned_sensor_range import LearnedSensorRange


class LearnedRangeKnee(LearnedSensorRange):
    """See the module: what `learned_sensor_knee` is to `learned_sensor_curve`."""

    name = "learned_range_knee"
    meaning = "the deflection sensor's slope changes at a share of each dome, found from the data"
    formula = "w − Σ c_k (w − s_k top)₊, top the highest dome of the curve, s_k from 0.3 to 0.96"
    source = "saturation and clipping of sensors; integrated random walk"
    parameters = slopes("the dome")

    def function(self, at: Array, values: Values) -> Array:
        """Return what is read too much (m,), in shares of the highest dome, at these shares."""
        return pieces(at, values, self.names)

    def sentence(self, x: Array, y: Array) -> str:
        """Say where it bends most."""
        return (
            "depends on the share of each curve's highest dome, not on suction or time: the "
            f"deflection sensor bends at {100 * corner(x, y):.0f} % of that dome, and reads "
            f"{100 * np.abs(y).max():.2g} % of it wrong at most, whatever its gain"
        )


EFFECT = LearnedRangeKnee()
