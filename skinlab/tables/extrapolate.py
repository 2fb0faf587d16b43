"""Fill the curves of a table where its entries do not hold, so that splines stay smooth elsewhere.

None of these values is ever an answer. But a cubic spline feels its neighbours, a quarter as much
with each node further away, and a cell whose corners all hold needs something smooth beyond them.
Stiffer skins hold further: from where a curve ends, it goes on by the increments of its stiffer
neighbours, extrapolated linearly to it.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def fill_curves(curves: Array) -> Array:
    """Return curves (scale, …, samples) with their NaNs filled; zero where there is nothing.

    Skins are stiffer along the first axis.
    """
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


def fill_ratios(values: Array, load_nodes: Array) -> Array:
    """Return the dimensionless table (h/R, ratios…, load) with its NaNs filled.

    Every row is finite on one stretch of two nodes or more, about zero load. Skins are stiffer
    along every axis of ratios; where there is no stiffer neighbour a row goes on straight.
    """
    filled = values.copy()
    inner = values.shape[1:-1]
    for plane in filled:
        for at in reversed(list(np.ndindex(*inner))):
            stiffer = None
            for axis, size in enumerate(inner):
                if at[axis] + 1 < size:
                    one, two = list(at), list(at)
                    one[axis] += 1
                    two[axis] = min(two[axis] + 2, size - 1)
                    stiffer = plane[tuple(one)], plane[tuple(two)]
                    break
            _continue(plane[at], stiffer, load_nodes)
    return filled


def _continue(row: Array, stiffer: tuple[Array, Array] | None, nodes: Array) -> None:
    held = np.flatnonzero(np.isfinite(row))
    first, last = int(held[0]), int(held[-1])
    below, above = slice(0, first), slice(last + 1, None)
    slope = (row[first + 1] - row[first]) / (nodes[first + 1] - nodes[first])
    row[below] = row[first] + slope * (nodes[below] - nodes[first])
    if stiffer is None:
        slope = (row[last] - row[last - 1]) / (nodes[last] - nodes[last - 1])
        row[above] = row[last] + slope * (nodes[above] - nodes[last])
    else:
        one, two = stiffer
        row[above] = row[last] + 2 * (one[above] - one[last]) - (two[above] - two[last])
