"""The few dimensions in which a table's curves live.

With orthonormal components Q of the curves at the samples of a measured one,
‖M − Ω‖² = ‖M⊥‖² + ‖c_M − c_Ω‖² exactly: a candidate costs a few multiplications instead of one per
sample.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

_DROPPED = 2e-6  # mm: a component is dropped that, in the mean over curves, is smaller than this
_ROWS = 400


def components(curves_mm: Array) -> Array:
    """Return orthonormal components (u, k) that hold these curves (n, u) to 2 nm."""
    rows = curves_mm[:: max(1, len(curves_mm) // _ROWS)]
    _, s, vt = np.linalg.svd(rows, full_matrices=False)
    k = max(1, int((s > _DROPPED * math.sqrt(len(rows))).sum()))
    return np.ascontiguousarray(vt[:k].T)
