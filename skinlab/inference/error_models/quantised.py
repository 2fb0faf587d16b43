"""Rounding to a step, which is found in the readings themselves.

Where the noise is above half a step, rounding is one more independent error of variance step²/12
(Widrow and Kollár 2008, Quantization Noise); below, see `interval_likelihood`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from skinlab.inference.error_models.base import Look, Part, Terms

Array = NDArray[np.float64]

_LEAST_UM = 0.2  # a smaller step is no error beside any sensor's noise
_OFF = 0.02  # of a step: how far from its lattice a reading may be
_FEWEST = 8  # different readings


def step_um(deflection_mm: Array) -> float:
    """Return the step of the lattice on which all readings (u,) lie, µm; 0 where there is none."""
    levels = np.unique(np.round(1e3 * deflection_mm, 6))
    if len(levels) < 3:
        return 0.0
    gaps = np.diff(levels)
    step = float(gaps.min())
    if step < _LEAST_UM or len(levels) < _FEWEST:
        return 0.0
    at = (levels - levels[0]) / step
    return step if float(np.abs(at - np.round(at)).max()) < _OFF else 0.0


@dataclass(frozen=True)
class Quantised:
    """Rounding of the deflection."""

    name: str = "quantised"
    meaning: str = "rounding to a step, which is found in the readings"
    prior: str = "step²/12"

    def part(self, look: Look) -> Part | None:
        """Return its part where the readings lie on a lattice."""
        step = step_um(look.samples.deflection_mm)
        if not step:
            return None
        variance = (1e-3 * step) ** 2 / 12.0

        def terms(values: Sequence[float]) -> Terms:
            del values
            return Terms(variance)

        return Part(
            "quantised", (), terms, always=True, stated={"step_um": step},
            why=f"readings come in steps of {step:g} µm",
        )  # fmt: skip


ERROR_MODEL = Quantised()
