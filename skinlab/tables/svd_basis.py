"""The few dimensions in which a table's curves live.

With orthonormal components Q of the curves at the samples of a measured one,
‖M − Ω‖² = ‖M⊥‖² + ‖c_M − c_Ω‖² exactly: a candidate costs a few multiplications instead of one per
sample.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from skinlab.tables.settings import INTERPOLATION

Array = NDArray[np.float64]

_ROWS = 400


def chosen(count: int) -> NDArray[np.intp]:
    """Return which (m,) of so many curves are enough for their components."""
    return np.arange(0, count, max(1, count // _ROWS))


def components(curves_mm: Array) -> Array:
    """Return orthonormal components (u, k) that hold these curves (n, u) to 2 nm."""
    _, s, vt = np.linalg.svd(curves_mm, full_matrices=False)
    k = max(1, int((s > INTERPOLATION.dropped_mm * math.sqrt(len(curves_mm))).sum()))
    return np.ascontiguousarray(vt[:k].T)
