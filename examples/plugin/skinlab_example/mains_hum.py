"""Hum of the mains in the deflection channel: a sine of 50 Hz, of unknown amplitude and phase.

At 20 or 100 samples a second it does not look like one (it is folded down), yet sine and cosine of
50 Hz at the times of the samples are its shape all the same.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

from skinlab.inference.error_models.base import Hyperparameter, Look, Part, Terms
from skinlab.inference.error_models.periodic import columns

MAINS_HZ = 50.0
SIZE = Hyperparameter("mains_hum_um", 2.0, 0.7)
ODDS = 0.2
FEWEST = 20  # samples


class MainsHum:
    """See the module."""

    name = "mains_hum"
    meaning = f"hum of the mains: a sine of {MAINS_HZ:g} Hz"
    prior = f"{SIZE.median:g} µm; {SIZE.log_sd:g}; odds 1 : {1 / ODDS:g}"

    def part(self, look: Look) -> Part | None:
        """Return its part; a handful of samples cannot tell it from other noise."""
        if len(look.samples) < FEWEST:
            return None
        waves = columns(look.samples, MAINS_HZ)

        def terms(values: Sequence[float]) -> Terms:
            return Terms(columns_mm=1e-3 * values[0] * waves)

        return Part(self.name, (SIZE,), terms, math.log(ODDS), lasting=True, why="the mains hum")


ERROR_MODEL = MainsHum()
