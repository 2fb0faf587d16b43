"""What grids of curves share: the few dimensions these live in, and the cells that hold."""

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


def cells_that_hold(nodes: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Return which cells of a grid have corners that all hold."""
    cells = nodes
    for axis in range(nodes.ndim):
        low = np.take(cells, np.arange(cells.shape[axis] - 1), axis)
        high = np.take(cells, np.arange(1, cells.shape[axis]), axis)
        cells = low & high
    return cells
