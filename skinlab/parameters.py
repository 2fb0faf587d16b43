"""The space of unknown parameters: names, units, bounds."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True)
class ParameterSpace:
    """A box of parameters; arrays of values have the shape (..., len(names)), in this order."""

    names: tuple[str, ...]  # they carry their unit: X1_MPa
    low: tuple[float, ...]
    high: tuple[float, ...]

    @property
    def bounds(self) -> tuple[Array, Array]:
        """Lower and upper bounds (k,)."""
        return np.array(self.low), np.array(self.high)

    def contains(self, values: Array) -> NDArray[np.bool_]:
        """Return which of the values (..., k) lie inside, bounds included."""
        low, high = self.bounds
        return np.asarray(((values >= low) & (values <= high)).all(axis=-1))
