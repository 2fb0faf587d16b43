"""A pressure channel that is bent over its whole range: it bows, and hardly more."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from skinlab.mechanics.effects.base import Array, Values
from skinlab.mechanics.effects.learned import coefficients, span
from skinlab.mechanics.effects.learned_pressure_curve import LearnedPressureCurve

_SHARES = (1.0, 0.3, 0.1)  # of the bow: how large each shape is beforehand


class LearnedPressureBow(LearnedPressureCurve):
    """See the module.

    What sensors are is told as a bow between the ends of their range, a few tenths of a percent to
    some percent of it. `learned_pressure_curve` can bend at low suctions as well, and pays for it.
    """

    name = "learned_pressure_bow"
    meaning = "the pressure channel is bent over its whole range, found from the data"
    formula = "p + Σ c_k sin(k π p/span)"
    source = "terminal-based nonlinearity of pressure sensors; Gaussian process"
    parameters = (
        *(
            replace(p, typical=3.0 * share)
            for p, share in zip(coefficients(3, "mbar", 50.0, 3.0), _SHARES, strict=True)
        ),
        span("span_mbar", "mbar", "suction up to which the curve is known", 10.0, 1000.0, 400.0),
    )

    def function(self, at: Array, values: Values) -> Array:
        """Return how much more suction is felt (m,), mbar, than is read."""
        x = np.clip(at / values["span_mbar"], -1.0, 1.0)
        return np.asarray(
            sum(values[n] * np.sin(k * np.pi * x) for k, n in enumerate(self.names, start=1))
        )


EFFECT = LearnedPressureBow()
