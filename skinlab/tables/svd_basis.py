"""The few dimensions in which a table's curves live, and the cells that hold.

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


def least_of_corners(values: Array) -> Array:
    """Return the least of its corners' values for each cell of a grid."""
    cells = values
    for axis in range(values.ndim):
        low = np.take(cells, np.arange(cells.shape[axis] - 1), axis)
        high = np.take(cells, np.arange(1, cells.shape[axis]), axis)
        cells = np.minimum(low, high)
    return cells
