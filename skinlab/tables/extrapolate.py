"""Fill the curves of a grid where its entries do not hold, so that splines stay smooth elsewhere.

As in `support.py`, none of these values is ever an answer: a cell speaks only where all its corners
hold. Stiffer skins (along X1, the first axis) hold further: from where a curve ends it goes on by
the increments of its stiffer neighbours, extrapolated to it.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def filled(curves: Array) -> Array:
    """Return the curves (X1, …, samples) with their NaNs filled; zero where there is nothing."""
    shape = curves.shape
    grid = curves.reshape(shape[0], -1, shape[-1]).copy()
    for i in range(shape[0] - 1, -1, -1):
        for j in np.flatnonzero(np.isnan(grid[i]).any(axis=-1)):
            row = grid[i, j]
            if i + 1 < shape[0]:
                guess = 2 * grid[i + 1, j] - grid[min(i + 2, shape[0] - 1), j]
            else:
                others = np.isfinite(grid[i]).any(axis=0)
                guess = np.zeros(shape[-1])
                guess[others] = np.nanmean(grid[i][:, others], axis=0)
            missing = np.isnan(row)
            held = np.flatnonzero(~missing)
            shift = row[held[-1]] - guess[held[-1]] if held.size else 0.0
            row[missing] = guess[missing] + shift
    return grid.reshape(shape)
