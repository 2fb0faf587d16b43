"""Noise of the pressure channel, which reaches the deflection through dw/dp."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from skinlab.inference.error_models.base import Array, Hyperparameter, Look, Part, Terms
from skinlab.inference.settings import KINDS


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

        def variances(values: Array) -> Array:
            return np.asarray(values[..., :1] ** 2 * per_mbar)

        def terms(values: Sequence[float]) -> Terms:
            return Terms(variances(np.array(values)))

        size = Hyperparameter("pressure_mbar", typical, KINDS.pressure_sd)
        return Part("pressure", (size,), terms, always=True, variances=variances)


ERROR_MODEL = Pressure()
