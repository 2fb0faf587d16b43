"""A curve through points with known slopes, without scipy: its import takes longer than many a one.

`scipy.interpolate.CubicHermiteSpline` gives the same bits, and can more.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]


class CubicHermite:
    """Piecewise cubic through `y` (n,) with slopes `dydx` (n,) at increasing `x` (n,), n > 1.

    Beyond both ends the end pieces go on.
    """

    def __init__(self, x: Array, y: Array, dydx: Array) -> None:
        self.x = x
        dx = np.diff(x)
        slope = np.diff(y) / dx
        t = (dydx[:-1] + dydx[1:] - 2 * slope) / dx
        self._c = np.stack([y[:-1], dydx[:-1], (slope - dydx[:-1]) / dx - t, t / dx])

    def __call__(self, at: ArrayLike, derivative: int = 0) -> Array:
        """Return the value at these x, or the first derivative."""
        p = np.asarray(at, dtype=float)
        piece = np.clip(np.searchsorted(self.x, p, side="right") - 1, 0, len(self.x) - 2)
        s = p - self.x[piece]
        c0, c1, c2, c3 = self._c[:, piece]
        if derivative:
            return np.asarray(c1 + c2 * s * 2.0 + c3 * (s * s) * 3.0)
        return np.asarray(c0 + c1 * s + c2 * (s * s) + c3 * (s * s * s))
