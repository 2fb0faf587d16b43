"""A deflection sensor that bends at once at a height: it saturates, or another range begins."""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from skinlab.mechanics.effects.base import Array, Parameter, Values
from skinlab.mechanics.effects.learned import LearnedEffect, Seen, less_gain, span

_KNOTS = tuple(np.linspace(0.3, 0.96, 12).round(3).tolist())  # shares of the range
_SOURCE = "straight pieces; how much they bend is learned from the data"


def slopes(of: str) -> tuple[Parameter, ...]:
    """Return the coefficients: slopes that are lost beyond each knot."""
    return tuple(
        Parameter(f"c{k}", "", f"slope lost above {at:g} of {of}", -3.0, 3.0, 0.0, 0.05, _SOURCE)
        for k, at in enumerate(_KNOTS, start=1)
    )


class LearnedSensorKnee(LearnedEffect):
    """See the module.

    `learned_sensor_curve` is smooth, and takes a dozen shapes to turn a corner. This is a chain of
    straight pieces whose slopes differ as the steps of a random walk do.
    """

    name = "learned_sensor_knee"
    family = "sensor_curve"
    meaning = "the deflection sensor's slope changes at a height, found from the data"
    formula = "w − Σ c_k (w − s_k span)₊, s_k from 0.3 to 0.96"
    source = "saturation and clipping of sensors; integrated random walk"
    physical = False
    range_name: ClassVar[str] = "span_mm"
    parameters = (
        *slopes("the span"),
        span("span_mm", "mm", "height up to which the curve is known", 0.05, 20.0, 0.7),
    )
    x_name = "deflection_mm"
    y_name = "reads_too_much_um"

    def read(self, since_s: Array, deflection_mm: Array, values: Values) -> Array:
        """Take off what is lost."""
        return deflection_mm + 1e-3 * self.function(deflection_mm, values)

    def range_of(self, seen: Seen) -> float:
        """Return the highest dome."""
        return seen.height_mm

    def abscissa(self, seen: Seen) -> Array:
        """Return heights up to the highest dome."""
        return np.linspace(0.0, seen.height_mm, 41)

    def function(self, at: Array, values: Values) -> Array:
        """Return what is read too much (m,), µm, at these heights."""
        whole = values["span_mm"]
        return 1e3 * whole * self.pieces(at / whole, values)

    def pieces(self, share: Array, values: Values) -> Array:
        """Return what is read too much (m,) at shares of the range, in the same unit."""
        lost = np.array([values[n] for n in self.names])
        return np.asarray(-np.maximum(share[:, None] - np.array(_KNOTS), 0.0) @ lost)

    def shown(self, x: Array, y: Array) -> Array:
        """Leave a gain out."""
        return less_gain(x, y)

    def sentence(self, x: Array, y: Array) -> str:
        """Say where it bends most."""
        return (
            "depends on the height of the dome alone, not on suction or time: the deflection "
            f"sensor bends at {_corner(x, y):.2g} mm, and reads {np.abs(y).max():.2g} µm wrong "
            "at most, whatever its gain"
        )


def _corner(x: Array, y: Array) -> float:
    """Return where a function bends most."""
    return float(x[1 + int(np.abs(np.diff(y, 2)).argmax())])


class LearnedRangeKnee(LearnedSensorKnee):
    """The same at a share of each curve's dome: a range that is set for each, as they clip."""

    name = "learned_range_knee"
    meaning = "the deflection sensor's slope changes at a share of each dome, found from the data"
    formula = "w − Σ c_k (w − s_k top)₊, top the highest dome of the curve, s_k from 0.3 to 0.96"
    range_name = ""
    parameters = slopes("the dome")
    x_name = "share_of_dome"
    y_name = "reads_too_much_of_dome"

    def read(self, since_s: Array, deflection_mm: Array, values: Values) -> Array:
        """Take off what is lost."""
        top = float(np.max(deflection_mm, initial=0.0))
        if top <= 0.0:
            return deflection_mm
        return np.asarray(deflection_mm + top * self.function(deflection_mm / top, values))

    def range_of(self, seen: Seen) -> float:
        """Return 1: shares."""
        return 1.0

    def abscissa(self, seen: Seen) -> Array:
        """Return shares of a dome."""
        return np.linspace(0.0, 1.0, 41)

    def function(self, at: Array, values: Values) -> Array:
        """Return what is read too much (m,), in shares of the highest dome, at these shares."""
        return self.pieces(at, values)

    def sentence(self, x: Array, y: Array) -> str:
        """Say where it bends most."""
        return (
            "depends on the share of each curve's highest dome, not on suction or time: the "
            f"deflection sensor bends at {100 * _corner(x, y):.0f} % of that dome, and reads "
            f"{100 * np.abs(y).max():.2g} % of it wrong at most, whatever its gain"
        )


EFFECT = LearnedSensorKnee()
