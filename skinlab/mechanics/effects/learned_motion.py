"""A motion to and fro whose phase each curve has for itself: a heartbeat, a breath."""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from skinlab.mechanics.effects.base import Array, Parameter, Values
from skinlab.mechanics.effects.learned import LearnedEffect, Seen, harmonics

_SOURCE = "found in what repeats do not have in common"


class LearnedMotion(LearnedEffect):
    """See the module.

    `learned_periodic` is in step with the beginning of each curve, as a pump is. The frequency and
    the size of this are learned with the errors; its phase in a new curve is not known.
    """

    name = "learned_motion"
    family = "periodic"
    meaning = "the probe moves to and fro, out of step with the curve, as found from the data"
    formula = "w + Σ s_k sin(2π k f t) + c_k cos(2π k f t), t from the curve's first sample"
    source = "pulse and breathing; Fourier series with a phase of its own for each curve"
    physical = False
    own_of_each = True
    range_name = "frequency_hz"
    harmonics = 1
    parameters: ClassVar[tuple[Parameter, ...]] = (
        Parameter("s1_um", "µm", "sine of the frequency", -300.0, 300.0, 0.0, 10.0, _SOURCE),
        Parameter("c1_um", "µm", "cosine of the frequency", -300.0, 300.0, 0.0, 10.0, _SOURCE),
        Parameter(
            "frequency_hz", "Hz", "how often in a second", 1e-3, 20.0, None, 1.0, _SOURCE, "log",
            default=1.0,
        ),
    )  # fmt: skip
    x_name = "time_s"
    y_name = "moves_by_um"

    def read(self, since_s: Array, deflection_mm: Array, values: Values) -> Array:
        """Add the motion."""
        return deflection_mm + 1e-3 * self.function(since_s, values)

    def abscissa(self, seen: Seen) -> Array:
        """Return times up to the longest."""
        return np.linspace(0.0, seen.time_s, 41)

    def function(self, at: Array, values: Values) -> Array:
        """Return the motion (m,), µm, at these times."""
        return harmonics(2.0 * np.pi * values["frequency_hz"] * at, values, self.harmonics)

    def shown(self, x: Array, y: Array) -> Array:
        """Return by how far it has moved since the first of the times."""
        return np.abs(y - y[..., :1])

    def sentence(self, x: Array, y: Array) -> str:
        """Say how often, and how far."""
        return (
            "comes again and again, whatever the suction: the probe moves to and fro by about "
            f"{y.max():.2g} µm every {x[-1]:.2g} s, in each curve with a phase of its own"
        )


EFFECT = LearnedMotion()
