"""A record that moves with the suction, whatever the skin does: the probe's frame gives."""

from __future__ import annotations

import numpy as np

from skinlab.mechanics.effects.base import Array, Values
from skinlab.mechanics.effects.learned import (
    LearnedEffect,
    Seen,
    line_and_sines,
    nearly_line,
    span,
    suction_share,
)

_BENT = 0.03  # of the line: how much the others are beforehand; instruments give nearly as springs


class LearnedFrame(LearnedEffect):
    """See the module.

    Suction pulls at the sensor's window and at what holds it as well as at the skin. Domes of all
    openings then stand higher or lower by the same length at the same suction. In proportion to it,
    as a spring gives, and what bends beside.
    """

    name = "learned_frame"
    family = "frame"
    meaning = "what holds the sensor gives with the suction, found from the data"
    formula = (
        "w + c1 p/span + Σ c_k sin((k − 3/2) π x), "
        "x = arsinh(p/20 mbar) / arsinh(span/20 mbar), k from 2 on"
    )
    source = "compliance of instruments; Gaussian process"
    physical = False
    needs_history = False
    range_name = "span_mbar"
    parameters = (
        *nearly_line("µm", 300.0, 40.0, _BENT),
        span("span_mbar", "mbar", "suction up to which the frame is known", 10.0, 1000.0, 400.0),
    )
    x_name = "pressure_mbar"
    y_name = "reads_too_much_um"

    def read(self, since_s: Array, deflection_mm: Array, values: Values) -> Array:
        """Leave it: without a suction nothing gives."""
        return deflection_mm

    def read_along(
        self, since_s: Array, pressure_mbar: Array, deflection_mm: Array, values: Values
    ) -> Array:
        """Add what the frame gives."""
        return np.asarray(deflection_mm + 1e-3 * self.function(pressure_mbar, values))

    def range_of(self, seen: Seen) -> float:
        """Return a little more than the highest suction."""
        return 1.25 * seen.pressure_mbar

    def abscissa(self, seen: Seen) -> Array:
        """Return suctions up to the highest one."""
        return np.linspace(0.0, seen.pressure_mbar, 41)

    def function(self, at: Array, values: Values) -> Array:
        """Return what is read too much (m,), µm, at these suctions."""
        whole = values["span_mbar"]
        return line_and_sines(at / whole, suction_share(at, whole), values, self.names)

    def sentence(self, x: Array, y: Array) -> str:
        """Say by how much the record moves."""
        i = int(np.abs(y).argmax())
        what = "much" if y[i] > 0 else "little"
        return (
            "depends on the suction alone, alike at every opening and rate, and not through the "
            f"skin: {abs(y[i]):.2g} µm too {what} are read at {x[i]:.0f} mbar, as where the "
            "sensor's window or frame gives"
        )


EFFECT = LearnedFrame()
