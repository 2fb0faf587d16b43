"""How far skin domes under a small load."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def small_load_compliance(
    thickness_over_radius: float | NDArray[np.float64],
) -> float | NDArray[np.float64]:
    """Return w/R / q for small q = p/X1, within 2 % for X2/X1 = 7, κ/X1 = 10.

    A fit to finite elements of the paper's law (docs/files.md).
    """
    t = thickness_over_radius
    return 0.0246 / t**3 + 0.0803 / t**2 - 0.0072 / t + 0.182
