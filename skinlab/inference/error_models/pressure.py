"""Noise of the pressure channel, which reaches the deflection through dw/dp."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from skinlab.inference.error_models.base import Hyperparameter, Look, Part, Terms

_LOG_SD = 0.2  # of the channel's own estimate


@dataclass(frozen=True)
class Pressure:
    """Independent errors of the pressure readings."""

    name: str = "pressure"
    meaning: str = "the pressure channel's noise through dw/dp"
    prior: str = "the channel's own estimate; 0.2"

    def part(self, look: Look) -> Part | None:
        """Return its part where the channel is noisy."""
        typical = float(np.sqrt(np.mean(np.square(look.pressure_sd_mbar))))
        if typical <= 0.0:
            return None
        per_mbar = np.square(look.pressure_error_mm / typical)

        def terms(values: Sequence[float]) -> Terms:
            return Terms(values[0] ** 2 * per_mbar)

        size = Hyperparameter("pressure_mbar", typical, _LOG_SD)
        return Part("pressure", (size,), terms, always=True)


ERROR_MODEL = Pressure()
