"""A deflection sensor that bends at once at a height: it saturates, or another range begins."""

from __future__ import annotations

import numpy as np

from skinlab.mechanics.effects.base import Array, Parameter, Values
from skinlab.mechanics.effects.learned import Seen, span
from skinlab.mechanics.effects.learned_sensor_curve import LearnedSensorCurve

_KNOTS = tuple(np.linspace(0.3, 0.96, 12).round(3).tolist())  # shares of the range
_SOURCE = "straight pieces; how much they bend is learned from the data"


def slopes(of: str) -> tuple[Parameter, ...]:
    """Return the coefficients of `pieces`: slopes that are lost beyond each knot."""
    return tuple(
        Parameter(f"c{k}", "", f"slope lost above {at:g} of {of}", -3.0, 3.0, 0.0, 0.05, _SOURCE)
        for k, at in enumerate(_KNOTS, start=1)
    )


def pieces(share: Array, values: Values, names: tuple[str, ...]) -> Array:
    """Return what is read too much (m,) at shares (m,) of the range, in shares of it."""
    lost = np.array([values[n] for n in names])
    return np.asarray(-np.maximum(share[:, None] - np.array(_KNOTS), 0.0) @ lost)


def corner(x: Array, y: Array) -> float:
    """Return where a function bends most."""
    return float(x[1 + int(np.abs(np.diff(y, 2)).argmax())])


class LearnedSensorKnee(LearnedSensorCurve):
    """See the module.

    `learned_sensor_curve` is smooth, and takes a dozen shapes to turn a corner. This is a chain of
    straight pieces whose slopes differ as the steps of a random walk do.
    """

    name = "learned_sensor_knee"
    meaning = "the deflection sensor's slope changes at a height, found from the data"
    formula = "w − Σ c_k (w − s_k span)₊, s_k from 0.3 to 0.96"
    source = "saturation and clipping of sensors; integrated random walk"
    parameters = (
        *slopes("the span"),
        span("span_mm", "mm", "height up to which the curve is known", 0.05, 20.0, 0.7),
    )

    def range_of(self, seen: Seen) -> float:
        """Return the highest dome."""
        return seen.height_mm

    def function(self, at: Array, values: Values) -> Array:
        """Return what is read too much (m,), µm, at these heights."""
        whole = values["span_mm"]
        return 1e3 * whole * pieces(at / whole, values, self.names)

    def sentence(self, x: Array, y: Array) -> str:
        """Say where it bends most."""
        return (
            "depends on the height of the dome alone, not on suction or time: the deflection "
            f"sensor bends at {corner(x, y):.2g} mm, and reads {np.abs(y).max():.2g} µm wrong "
            "at most, whatever its gain"
        )


EFFECT = LearnedSensorKnee()
